#include <sys/stat.h>
#include <unistd.h>
#include <catch2/catch.hpp>

#include <filesystem>

#include "server/access/allowed_key.h"
#include "server/access/certificate_file.h"
#include "server/access/gate.h"

namespace allowed_key_test {

using namespace rustle;
using namespace rustle::access;
namespace fs = std::filesystem;

namespace {

struct Folder {
  fs::path path = fs::temp_directory_path() / ("rustle-access-" + std::to_string(::getpid()));
  Folder() {
    fs::remove_all(path);
    fs::create_directories(path / "allowed");
  }
  ~Folder() { fs::remove_all(path); }
};

client::Certificate with(std::map<std::string, std::string> metadata) {
  auto made = client::make_certificate().value();
  made.metadata = std::move(metadata);
  return made;
}

}  // namespace

TEST_CASE("an allowed key says in its file what it may", "[access]") {
  const auto key =
      allowed_key(with({{"permissions", "publish listen"}, {"sessions", "4"}, {"frames_per_s", "240"}}), "a/flag.key");
  REQUIRE(key.has_value());
  CHECK(key->name == "flag");
  CHECK(key->permissions == Permissions{.publish = true, .listen = true, .admin = false});
  CHECK(key->quotas == Quotas{.sessions = 4, .frames_per_s = 240});
  CHECK(allowed_key(certificate_of(*key), "flag.key") == *key);
}

TEST_CASE("what is no permission or quota is named", "[access]") {
  const auto why = [](std::map<std::string, std::string> metadata) {
    return allowed_key(with(std::move(metadata)), "k.key").error();
  };
  CHECK(why({{"permissions", "publish fly"}}).find("\"fly\"") != std::string::npos);
  CHECK(why({}).find("may nothing") != std::string::npos);
  CHECK(why({{"permissions", " "}}).find("may nothing") != std::string::npos);
  for (const char* number : {"-1", "1.5", "", "four", "99999999999999999999999"})
    CHECK(why({{"permissions", "listen"}, {"voices", number}}).find("voices") != std::string::npos);
  CHECK(why({{"permissions", "listen"}, {"minutes", "3"}}).find("\"minutes\"") != std::string::npos);
}

TEST_CASE("names of keys are file names and nothing else", "[access]") {
  for (const char* good : {"flag", "a.b-c_9", "9"}) CHECK(is_key_name(good));
  for (const char* bad : {"", ".", "..", ".x", "a/b", "../x", "a b", "a\n", "ä"}) CHECK_FALSE(is_key_name(bad));
  CHECK_FALSE(is_key_name(std::string(65, 'a')));
}

TEST_CASE("a gate reads its folder whole or not at all", "[access]") {
  const Folder folder;
  CHECK(Gate::open(folder.path).error().find("rustle keys new server") != std::string::npos);
  const auto own = client::make_certificate().value();
  REQUIRE(write_certificate(folder.path / "server.key_secret", own, true));
  const auto gate = Gate::open(folder.path).value();
  CHECK(gate->own().secret_key == own.secret_key);

  const auto flag = with({{"permissions", "publish"}});
  CHECK_FALSE(gate->admits(flag.public_key));
  REQUIRE(write_certificate(folder.path / "allowed/flag.key", flag, false));
  CHECK_FALSE(gate->admits(flag.public_key));
  REQUIRE(gate->reload());
  CHECK(gate->admits(flag.public_key));
  CHECK(gate->named("flag")->public_key == flag.public_key);
  CHECK(gate->find(flag.public_key)->name == "flag");

  REQUIRE(write_certificate(folder.path / "allowed/again.key", flag, false));
  const auto twice = gate->reload();
  REQUIRE_FALSE(twice.has_value());
  CHECK(twice.error().find("again") != std::string::npos);
  CHECK(gate->admits(flag.public_key));

  fs::remove(folder.path / "allowed/again.key");
  fs::remove(folder.path / "allowed/flag.key");
  REQUIRE(gate->reload());
  CHECK_FALSE(gate->admits(flag.public_key));
}

TEST_CASE("a secret that others may read is not used", "[access]") {
  const Folder folder;
  REQUIRE(write_certificate(folder.path / "server.key_secret", client::make_certificate().value(), true));
  CHECK(Gate::open(folder.path).has_value());
  fs::permissions(folder.path / "server.key_secret", fs::perms::group_read, fs::perm_options::add);
  CHECK(Gate::open(folder.path).error().find("chmod 600") != std::string::npos);
}

TEST_CASE("a certificate is written whole or not at all, a secret for its owner", "[access]") {
  Folder folder;
  const auto own = client::make_certificate().value();
  const auto mode = [&](const char* name) {
    struct stat status {};
    REQUIRE(::stat((folder.path / name).c_str(), &status) == 0);
    return status.st_mode & 0777;
  };
  REQUIRE(write_certificate(folder.path / "own.key_secret", own, true));
  REQUIRE(write_certificate(folder.path / "own.key", own, false));
  CHECK(mode("own.key_secret") == 0600);
  CHECK(mode("own.key") == 0644);
  CHECK(client::read_certificate(folder.path / "own.key_secret")->secret_key == own.secret_key);
  CHECK(client::read_certificate(folder.path / "own.key")->secret_key.empty());
  const auto nowhere = write_certificate(folder.path / "none/own.key", own, false);
  REQUIRE(!nowhere);
  CHECK(nowhere.error().message.find("cannot be written") != std::string::npos);
  CHECK(std::distance(fs::directory_iterator(folder.path), fs::directory_iterator()) == 3);  // with "allowed"
}

}  // namespace allowed_key_test
