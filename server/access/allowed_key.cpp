#include "server/access/allowed_key.h"

#include <algorithm>
#include <charconv>
#include <system_error>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace rustle::access {
namespace {

constexpr std::string_view kPermissions = "permissions";

std::string text_of(const client::Error& error) {
  return fmt::format("{}: {} {}", error.field, error.message, error.remedy);
}

}  // namespace

std::vector<std::pair<std::string_view, std::uint64_t Quotas::*>> quota_list() {
  return {{"sessions", &Quotas::sessions},
          {"triangles", &Quotas::triangles},
          {"bytes_per_s", &Quotas::bytes_per_s},
          {"frames_per_s", &Quotas::frames_per_s},
          {"voices", &Quotas::voices}};
}

std::string text_of(const Permissions& permissions) {
  std::vector<std::string_view> words;
  if (permissions.publish) words.emplace_back("publish");
  if (permissions.listen) words.emplace_back("listen");
  if (permissions.admin) words.emplace_back("admin");
  return words.empty() ? "none" : fmt::format("{}", fmt::join(words, " "));
}

bool is_key_name(std::string_view name) {
  if (name.empty() || name.size() > 64 || name.front() == '.') return false;
  for (const char c : name) {
    const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
    if (!plain && c != '.' && c != '-' && c != '_') return false;
  }
  return true;
}

tl::expected<AllowedKey, std::string> allowed_key(const client::Certificate& certificate,
                                                  const std::filesystem::path& file) {
  AllowedKey key{.name = file.stem().string(), .public_key = certificate.public_key, .permissions = {}, .quotas = {}};
  for (const auto& [name, value] : certificate.metadata) {
    if (name == kPermissions) {
      std::string_view rest = value;
      while (!rest.empty()) {
        const std::string_view word = rest.substr(0, rest.find(' '));
        rest.remove_prefix(std::min(word.size() + 1, rest.size()));
        if (word.empty()) continue;
        if (word != "publish" && word != "listen" && word != "admin")
          return tl::unexpected(
              fmt::format("{}: \"{}\" is no permission; there are publish, listen and admin.", file.string(), word));
        (word == "publish"  ? key.permissions.publish
         : word == "listen" ? key.permissions.listen
                            : key.permissions.admin) = true;
      }
      continue;
    }
    bool known = false;
    for (const auto& [quota, member] : quota_list()) {
      if (name != quota) continue;
      known = true;
      const auto [end, failed] = std::from_chars(value.data(), value.data() + value.size(), key.quotas.*member);
      if (failed != std::errc() || end != value.data() + value.size())
        return tl::unexpected(fmt::format("{}: {} is \"{}\"; give a whole number, 0 for as much as the daemon has.",
                                          file.string(), name, value));
    }
    if (!known)
      return tl::unexpected(fmt::format(
          "{}: \"{}\" is not known; there are permissions, sessions, triangles, bytes_per_s, frames_per_s and voices.",
          file.string(), name));
  }
  if (key.permissions == Permissions{})
    return tl::unexpected(
        fmt::format("{}: it may nothing; say permissions = \"publish\", or revoke the key.", file.string()));
  return key;
}

client::Certificate certificate_of(const AllowedKey& key) {
  client::Certificate certificate{.public_key = key.public_key};
  certificate.metadata.emplace(kPermissions, text_of(key.permissions));
  for (const auto& [name, member] : quota_list())
    if (key.quotas.*member != 0) certificate.metadata.emplace(name, std::to_string(key.quotas.*member));
  return certificate;
}

std::filesystem::path allowed_file(const std::filesystem::path& folder, std::string_view name) {
  return folder / "allowed" / fmt::format("{}.key", name);
}

tl::expected<AllowedKeys, std::string> AllowedKeys::read(const std::filesystem::path& folder) {
  AllowedKeys out;
  std::error_code failed;
  const auto allowed = folder / "allowed";
  if (!std::filesystem::exists(allowed, failed) && !failed) return out;
  for (const auto& entry : std::filesystem::directory_iterator(allowed, failed)) {
    if (entry.path().extension() != ".key") continue;
    const auto certificate = client::read_certificate(entry.path());
    if (!certificate) return tl::unexpected(text_of(certificate.error()));
    auto key = allowed_key(*certificate, entry.path());
    if (!key) return tl::unexpected(std::move(key.error()));
    const auto [known, fresh] = out.keys_.emplace(key->public_key, *key);
    if (!fresh)
      return tl::unexpected(
          fmt::format("{}: this is the key of {} too; revoke one of the two.", entry.path().string(), known->second.name));
  }
  if (failed)
    return tl::unexpected(
        fmt::format("{}: it cannot be read: {}; let rustled read the folder.", allowed.string(), failed.message()));
  return out;
}

const AllowedKey* AllowedKeys::find(const std::string& public_key) const {
  const auto known = keys_.find(public_key);
  return known == keys_.end() ? nullptr : &known->second;
}

const AllowedKey* AllowedKeys::named(std::string_view name) const {
  for (const auto& [public_key, key] : keys_)
    if (key.name == name) return &key;
  return nullptr;
}

}  // namespace rustle::access
