#include "server/access/gate.h"

#include <sys/stat.h>

#include <cstdlib>
#include <system_error>
#include <utility>

#include <fmt/format.h>

namespace rustle::access {
namespace {

std::filesystem::path secret_file(const std::filesystem::path& folder) {
  constexpr const char* kName = "server.key_secret";
  std::error_code failed;
  if (const char* credentials = std::getenv("CREDENTIALS_DIRECTORY")) {
    if (const auto passed = std::filesystem::path(credentials) / kName; std::filesystem::exists(passed, failed))
      return passed;
  }
  return folder / kName;
}

}  // namespace

Gate::Gate(std::filesystem::path folder, client::Certificate own, AllowedKeys allowed)
    : folder_(std::move(folder)), own_(std::move(own)), allowed_(std::make_shared<const AllowedKeys>(std::move(allowed))) {}

tl::expected<std::shared_ptr<Gate>, std::string> Gate::open(const std::filesystem::path& folder) {
  const auto file = secret_file(folder);
  auto own = client::read_certificate(file);
  if (!own || own->secret_key.empty())
    return tl::unexpected(fmt::format("{}: {} Make the daemon's own pair with `rustle keys new server --folder {}`.",
                                      file.string(), own ? "It holds no secret-key." : own.error().message,
                                      folder.string()));
  struct stat status {};
  if (::stat(file.c_str(), &status) == 0 && (status.st_mode & 0077) != 0)
    return tl::unexpected(
        fmt::format("{}: others than its owner may use this secret; chmod 600 it, or make a new pair.", file.string()));
  auto allowed = AllowedKeys::read(folder);
  if (!allowed) return tl::unexpected(std::move(allowed.error()));
  return std::shared_ptr<Gate>(new Gate(folder, std::move(*own), std::move(*allowed)));
}

std::shared_ptr<const AllowedKeys> Gate::allowed() const {
  const std::lock_guard lock(mutex_);
  return allowed_;
}

std::optional<AllowedKey> Gate::find(const std::string& public_key) const {
  const auto keys = allowed();
  const AllowedKey* key = keys->find(public_key);
  return key == nullptr ? std::nullopt : std::optional(*key);
}

bool Gate::admits(const std::string& public_key) const {
  return allowed()->find(public_key) != nullptr;
}

std::optional<AllowedKey> Gate::named(const std::string& name) const {
  const auto keys = allowed();
  const AllowedKey* key = keys->named(name);
  return key == nullptr ? std::nullopt : std::optional(*key);
}

tl::expected<void, std::string> Gate::reload() {
  auto read = AllowedKeys::read(folder_);
  if (!read) return tl::unexpected(std::move(read.error()));
  auto fresh = std::make_shared<const AllowedKeys>(std::move(*read));
  const std::lock_guard lock(mutex_);
  allowed_ = std::move(fresh);
  return {};
}

}  // namespace rustle::access
