#include <unistd.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>

#include "server/page/static_files.h"

namespace page_static_files_test {
namespace {

using namespace rustle::page;
namespace fs = std::filesystem;

struct Site {
  Site() : root(fs::temp_directory_path() / ("rustle-page-" + std::to_string(::getpid()))), folder(root / "page") {
    fs::remove_all(root);
    fs::create_directories(folder / "assets");
    write(root / "secret.txt", "secret");
    write(folder / ".hidden", "secret");
    write(folder / "index.html", "<html>");
    write(folder / "assets/three-AbC_1.js", "export {}");
    write(folder / "sound.wasm", std::string(1, '\0') + "asm");
  }
  ~Site() { fs::remove_all(root); }
  static void write(const fs::path& file, const std::string& text) { std::ofstream(file, std::ios::binary) << text; }
  const fs::path root, folder;
};

rustle::monitor::HttpRequest asked(std::string path) {
  return {std::move(path), {}, "127.0.0.1:7393"};
}

}  // namespace

TEST_CASE("files have their types, and only those with a hash in their name are kept", "[page]") {
  const Site site;
  const StaticFiles files(site.folder);
  const auto index = files.answer(asked("/"));
  REQUIRE(index);
  CHECK(index->body == "<html>");
  CHECK(index->type == "text/html; charset=utf-8");
  CHECK(index->keep == "no-cache");
  const auto policy = std::find_if(index->more.begin(), index->more.end(),
                                   [](const auto& field) { return field.first == "Content-Security-Policy"; });
  REQUIRE(policy != index->more.end());
  CHECK_THAT(policy->second, Catch::Contains("default-src 'self'") && Catch::Contains("ws://127.0.0.1:7393"));
  const auto script = files.answer(asked("/assets/three-AbC_1.js"));
  REQUIRE(script);
  CHECK(script->type == "text/javascript; charset=utf-8");
  CHECK_THAT(script->keep, Catch::Contains("immutable"));
  CHECK(files.answer(asked("/sound.wasm"))->type == "application/wasm");
  CHECK(files.answer(asked("/sound.wasm"))->body.size() == 4);
}

TEST_CASE("no path leads out of the folder", "[page]") {
  const Site site;
  const StaticFiles files(site.folder);
  const std::string nul("/index.html\0.js", 15);
  for (const std::string& path : std::vector<std::string>{
           "/../secret.txt", "/assets/../../secret.txt", "//etc/passwd", "/.hidden", "/assets", "/assets/", "/./index.html",
           "/assets//three-AbC_1.js", "secret.txt", "", "/index.html/", "/..", "/a\\..\\secret.txt", nul}) {
    INFO(path);
    CHECK_FALSE(files.answer(asked(path)));
  }
}

TEST_CASE("where the page was not built, it is said what to do", "[page]") {
  const Site site;
  const StaticFiles files(site.root / "nowhere");
  const auto index = files.answer(asked("/"));
  REQUIRE(index);
  CHECK(index->status == 200);
  CHECK_THAT(index->body, Catch::Contains("RUSTLE_PAGE_PATH") && Catch::Contains("/metrics") && Catch::Contains("nowhere"));
  CHECK_FALSE(files.answer(asked("/assets/three-AbC_1.js")));
}

}  // namespace page_static_files_test
