#include "client_sdk/cpp/certificate.h"

#include <zmq.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <system_error>
#include <utility>
#include <vector>

namespace rustle::client {
namespace {

constexpr std::size_t kMostBytes = std::size_t{64} << 10;
constexpr std::size_t kKeyCharacters = 40;
constexpr const char* kNewKey = "Make a pair with `rustle keys new NAME`.";

tl::unexpected<Error> invalid(std::string field, std::string message, std::string remedy) {
  return tl::unexpected(Error{.code = 0,
                              .code_name = "invalid",
                              .field = std::move(field),
                              .message = std::move(message),
                              .remedy = std::move(remedy)});
}

std::string_view trimmed(std::string_view text) {
  constexpr std::string_view kBlank = " \t\r";
  const std::size_t first = text.find_first_not_of(kBlank);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kBlank) - first + 1);
}

std::string_view without_quotes(std::string_view text) {
  if (text.size() >= 2 && (text.front() == '"' || text.front() == '\'') && text.back() == text.front())
    return text.substr(1, text.size() - 2);
  return text;
}

bool is_key(const std::string& text) {
  std::array<std::uint8_t, 32> bytes{};
  return text.size() == kKeyCharacters && zmq_z85_decode(bytes.data(), text.c_str()) != nullptr;
}

}  // namespace

tl::expected<Certificate, Error> make_certificate() {
  std::array<char, kKeyCharacters + 1> public_key{}, secret_key{};
  if (zmq_curve_keypair(public_key.data(), secret_key.data()) != 0)
    return invalid({}, "This ZeroMQ makes no CURVE keys.", "Install libzmq with libsodium.");
  return Certificate{.public_key = public_key.data(), .secret_key = secret_key.data()};
}

tl::expected<std::string, Error> public_key_of(const std::string& secret_key) {
  std::array<char, kKeyCharacters + 1> derived{};
  if (!is_key(secret_key) || zmq_curve_public(derived.data(), secret_key.c_str()) != 0)
    return invalid("secret-key", "This is no key: 40 characters of Z85 are one.", kNewKey);
  return std::string(derived.data());
}

tl::expected<Certificate, Error> parse_certificate(std::string_view text, const std::string& file) {
  if (text.size() > kMostBytes)
    return invalid(file, "It is longer than a certificate may be (64 KiB).", "Name a file that holds one key.");
  Certificate out;
  std::string section;
  std::size_t number = 0;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    const std::string_view line = trimmed(text.substr(at, end - at));
    at = end + 1;
    ++number;
    if (line.empty() || line.front() == '#') continue;
    const std::size_t equals = line.find('=');
    if (equals == std::string_view::npos) {
      section = line;
      continue;
    }
    const std::string name(trimmed(line.substr(0, equals)));
    const std::string value(without_quotes(trimmed(line.substr(equals + 1))));
    const std::string place = file + ":" + std::to_string(number);
    if (section == "metadata") {
      if (!out.metadata.emplace(name, value).second)
        return invalid(place, "\"" + name + "\" is said twice.", "Leave one of the two lines.");
    } else if (section == "curve" && (name == "public-key" || name == "secret-key")) {
      std::string& key = name == "public-key" ? out.public_key : out.secret_key;
      if (!key.empty()) return invalid(place, "\"" + name + "\" is said twice.", "Leave one of the two lines.");
      if (!is_key(value)) return invalid(place, "This is no key: 40 characters of Z85 are one.", kNewKey);
      key = value;
    }
  }
  if (out.public_key.empty()) return invalid(file, "It holds no public-key below \"curve\".", kNewKey);
  if (!out.secret_key.empty()) {
    const auto derived = public_key_of(out.secret_key);
    if (!derived || out.public_key != *derived)
      return invalid(file, "Its secret key is of another public key.", "Take the pair as it was made.");
  }
  return out;
}

tl::expected<Certificate, Error> read_certificate(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) return invalid(file.string(), std::string("It cannot be read: ") + std::strerror(errno) + ".", kNewKey);
  std::string text(kMostBytes + 1, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  if (in.bad()) return invalid(file.string(), "It cannot be read.", "Name a file, not a folder.");
  text.resize(static_cast<std::size_t>(in.gcount()));
  return parse_certificate(text, file.string());
}

std::string certificate_text(const Certificate& certificate, bool secret) {
  std::string text = secret
                         ? "# ZeroMQ CURVE **Secret** Certificate\n# DO NOT PROVIDE THIS FILE TO OTHER USERS nor change its "
                           "permissions.\n\nmetadata\n"
                         : "# ZeroMQ CURVE Public Certificate\n# Exchange securely, or use a secure mechanism to verify the "
                           "contents of this file after exchange.\n\nmetadata\n";
  for (const auto& [name, value] : certificate.metadata) text += "    " + name + " = \"" + value + "\"\n";
  text += "curve\n    public-key = \"" + certificate.public_key + "\"\n";
  if (secret) text += "    secret-key = \"" + certificate.secret_key + "\"\n";
  return text;
}

tl::expected<Keys, Error> read_keys(const std::filesystem::path& folder) {
  std::error_code failed;
  std::vector<std::filesystem::path> secrets;
  for (const auto& entry : std::filesystem::directory_iterator(folder, failed))
    if (entry.path().extension() == ".key_secret") secrets.push_back(entry.path());
  if (failed)
    return invalid(folder.string(), "The folder of keys cannot be read: " + failed.message() + ".",
                   "Name a folder with NAME.key_secret, your own, and server.key, the daemon's.");
  if (secrets.size() != 1)
    return invalid(folder.string(),
                   secrets.empty() ? std::string("There is no NAME.key_secret in it.")
                                   : "There are " + std::to_string(secrets.size()) + " secret keys in it.",
                   secrets.empty() ? kNewKey : "Leave one, or name a folder of its own for each.");
  auto own = read_certificate(secrets.front());
  if (!own) return tl::unexpected(std::move(own.error()));
  if (own->secret_key.empty()) return invalid(secrets.front().string(), "It holds no secret-key.", kNewKey);
  auto server = read_certificate(folder / "server.key");
  if (!server) {
    server.error().remedy = "Put the daemon's server.key there, as its operator gives it.";
    return tl::unexpected(std::move(server.error()));
  }
  return Keys{.public_key = std::move(own->public_key),
              .secret_key = std::move(own->secret_key),
              .server_key = std::move(server->public_key)};
}

}  // namespace rustle::client
