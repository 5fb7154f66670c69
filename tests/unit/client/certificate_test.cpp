#include <unistd.h>
#include <catch2/catch.hpp>

#include <filesystem>
#include <fstream>

#include "client_sdk/cpp/certificate.h"

namespace certificate_test {

using namespace rustle::client;
namespace fs = std::filesystem;

namespace {

fs::path fresh_folder() {
  const fs::path folder = fs::temp_directory_path() / ("rustle-keys-" + std::to_string(::getpid()));
  fs::remove_all(folder);
  fs::create_directories(folder);
  return folder;
}

void save(const fs::path& file, const Certificate& certificate, bool secret) {
  std::ofstream(file) << certificate_text(certificate, secret);
}

std::string field_of(std::string_view text) {
  const auto parsed = parse_certificate(text, "f");
  return parsed ? "" : parsed.error().field;
}

}  // namespace

TEST_CASE("a certificate is read as it was written, and as pyzmq writes it", "[client][certificate]") {
  Certificate made = make_certificate().value();
  made.metadata = {{"permissions", "publish"}, {"sessions", "4"}};
  for (const bool secret : {false, true}) {
    const auto read = parse_certificate(certificate_text(made, secret), "f").value();
    CHECK(read.public_key == made.public_key);
    CHECK(read.secret_key == (secret ? made.secret_key : ""));
    CHECK(read.metadata == made.metadata);
  }
  const auto pyzmq =
      parse_certificate("#   ****  Generated on 2026 by pyzmq  ****\r\nmetadata\r\n    a = b = c\ncurve\n\tpublic-key = '" +
                            made.public_key + "'\n    secret-key = \"" + made.secret_key + "\"",
                        "f");
  REQUIRE(pyzmq.has_value());
  CHECK(pyzmq->metadata.at("a") == "b = c");
}

TEST_CASE("what is no certificate is named with its line", "[client][certificate]") {
  const Certificate one = make_certificate().value(), other = make_certificate().value();
  const std::string line = "public-key = \"" + one.public_key + "\"\n";
  CHECK(field_of("curve\n" + line) == "");
  CHECK(field_of("") == "f");
  CHECK(field_of(line) == "f");  // no section
  CHECK(field_of("metadata\n" + line) == "f");
  CHECK(field_of("curve\n" + line + line) == "f:3");
  CHECK(field_of("curve\npublic-key = \"short\"\n") == "f:2");
  CHECK(field_of("curve\npublic-key = \"" + std::string(40, ' ') + "\"\n") == "f:2");
  CHECK(field_of("curve\npublic-key = \"" + std::string(40, '\xff') + "\"\n") == "f:2");
  CHECK(field_of("metadata\na = 1\na = 2\ncurve\n" + line) == "f:3");
  CHECK(field_of("curve\n" + line + "secret-key = \"" + other.secret_key + "\"\n") == "f");
  CHECK(field_of(std::string(70'000, '#')) == "f");
}

TEST_CASE("a folder of keys holds one secret, and the server's key", "[client][certificate]") {
  const fs::path folder = fresh_folder();
  const Certificate own = make_certificate().value(), server = make_certificate().value();
  CHECK(read_keys(folder / "none").error().code_name == "invalid");
  CHECK(read_keys(folder).error().message.find("no NAME.key_secret") != std::string::npos);
  save(folder / "own.key_secret", own, true);
  save(folder / "own.key", own, false);
  CHECK(read_keys(folder).error().field == (folder / "server.key").string());
  save(folder / "server.key", server, false);
  const Keys keys = read_keys(folder).value();
  CHECK(keys.public_key == own.public_key);
  CHECK(keys.secret_key == own.secret_key);
  CHECK(keys.server_key == server.public_key);
  save(folder / "second.key_secret", server, true);
  CHECK(read_keys(folder).error().message.find("2 secret keys") != std::string::npos);
  fs::remove(folder / "own.key_secret");
  fs::remove(folder / "second.key_secret");
  save(folder / "public.key_secret", own, false);
  CHECK(read_keys(folder).error().message.find("no secret-key") != std::string::npos);
  fs::remove_all(folder);
}

}  // namespace certificate_test
