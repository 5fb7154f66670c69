#include "server/page/static_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <system_error>
#include <utility>

namespace rustle::page {
namespace {

namespace fs = std::filesystem;

constexpr const char* kForEver = "public, max-age=31536000, immutable";

/// What a browser may do with the page: only what came from here runs, and nobody frames it.
std::vector<std::pair<std::string, std::string>> guards(const std::string& host) {
  // Where 'self' is not taken to hold for WebSockets, they are named. A Host that was served is a plain name.
  const std::string sockets = host.empty() ? "" : fmt::format(" ws://{} wss://{}", host, host);
  return {
      {"Content-Security-Policy", "default-src 'self'; connect-src 'self'" + sockets +
                                      "; object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"},
      {"X-Content-Type-Options", "nosniff"},
      {"Referrer-Policy", "no-referrer"},
      {"Cross-Origin-Resource-Policy", "same-origin"}};
}

const char* type_of(const fs::path& file) {
  constexpr std::array<std::pair<const char*, const char*>, 14> kTypes = {{
      {".html", "text/html; charset=utf-8"},
      {".js", "text/javascript; charset=utf-8"},
      {".mjs", "text/javascript; charset=utf-8"},
      {".css", "text/css; charset=utf-8"},
      {".json", "application/json"},
      {".map", "application/json"},
      {".svg", "image/svg+xml"},
      {".png", "image/png"},
      {".ico", "image/x-icon"},
      {".webp", "image/webp"},
      {".woff2", "font/woff2"},
      {".wasm", "application/wasm"},
      {".webmanifest", "application/manifest+json"},
      {".txt", "text/plain; charset=utf-8"},
  }};
  const std::string ending = file.extension().string();
  const auto known = std::find_if(kTypes.begin(), kTypes.end(), [&](const auto& type) { return ending == type.first; });
  return known == kTypes.end() ? "application/octet-stream" : known->second;
}

/// The names of a path, one below the other; nothing: one of them is no plain name.
std::optional<fs::path> plain_path(std::string_view path) {
  fs::path out;
  while (!path.empty()) {
    path.remove_prefix(1);  // the slash
    const std::string_view name = path.substr(0, path.find('/'));
    const bool plain = !name.empty() && name.front() != '.' && std::all_of(name.begin(), name.end(), [](unsigned char c) {
      return std::isalnum(c) != 0 || c == '.' || c == '-' || c == '_';
    });
    if (!plain) return std::nullopt;
    out /= name;
    path.remove_prefix(name.size());
  }
  return out;
}

std::optional<std::string> contents(const fs::path& file) {
  std::error_code failed;
  if (!fs::is_regular_file(file, failed)) return std::nullopt;
  const auto size = fs::file_size(file, failed);
  if (failed || size > StaticFiles::kFileBytes) return std::nullopt;
  std::ifstream in(file, std::ios::binary);
  std::string out{std::istreambuf_iterator<char>(in), {}};
  return in.bad() || out.size() != size ? std::nullopt : std::optional(std::move(out));
}

/// Where the page was not built: the rest of the server is there.
std::string missing_page(const fs::path& folder) {
  return fmt::format(
      "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><title>rustled</title>\n"
      "<h1>rustled is running; its page is not installed</h1>\n"
      "<p>Install the package <code>rustle-page</code>; or install Node.js and npm and build Rustle again "
      "(<code>cmake --preset release -DRUSTLE_PAGE=ON &amp;&amp; cmake --build --preset release</code>); or name the folder "
      "of a page that is built in <code>RUSTLE_PAGE_PATH</code>. "
      "Looked in <code>{}</code>.</p>\n"
      "<p>Meanwhile: <a href=\"/healthz\">/healthz</a>, <a href=\"/metrics\">/metrics</a>, "
      "<a href=\"/figures\">/figures</a>, or <code>rustle top</code>.</p>\n</html>\n",
      folder.string());
}

}  // namespace

fs::path page_folder() {
  if (const char* named = std::getenv("RUSTLE_PAGE_PATH"); named != nullptr && *named != '\0') return named;
  std::vector<fs::path> places;
  std::error_code failed;
  const fs::path program = fs::read_symlink("/proc/self/exe", failed);
  if (!failed) places.push_back((program.parent_path() / "../share/rustle/page").lexically_normal());
  places.emplace_back("/usr/share/rustle/page");
  const auto there = std::find_if(places.begin(), places.end(), [](const fs::path& place) {
    std::error_code none;
    return fs::exists(place / "index.html", none);
  });
  return there == places.end() ? places.front() : *there;
}

std::optional<monitor::HttpResponse> StaticFiles::answer(const monitor::HttpRequest& request) const {
  const bool index = request.path == "/" || request.path == "/index.html";
  const auto name = index ? fs::path("index.html") : plain_path(request.path);
  if (!name) return std::nullopt;
  auto body = contents(folder_ / *name);
  if (!body && !index) return std::nullopt;
  monitor::HttpResponse out{200, type_of(*name), body ? std::move(*body) : missing_page(folder_), "no-cache",
                            guards(request.host)};
  // Their names change with what they hold.
  if (*name->begin() == "assets") out.keep = kForEver;
  return out;
}

}  // namespace rustle::page
