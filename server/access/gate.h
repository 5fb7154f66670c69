#pragma once

#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include <tl/expected.hpp>

#include "server/access/allowed_key.h"

namespace rustle::access {

/// A daemon's own key and the keys it admits, which may be read again while it runs. Any thread.
class Gate {
 public:
  /// The secret that the service manager passes on (server.key_secret in CREDENTIALS_DIRECTORY), or else
  /// FOLDER/server.key_secret; and FOLDER/allowed. Error: a sentence with file and remedy.
  [[nodiscard]] static tl::expected<std::shared_ptr<Gate>, std::string> open(const std::filesystem::path& folder);

  const client::Certificate& own() const { return own_; }

  /// Nothing: the key is not allowed.
  std::optional<AllowedKey> find(const std::string& public_key) const;
  bool admits(const std::string& public_key) const;
  /// The key of this name.
  std::optional<AllowedKey> named(const std::string& name) const;

  /// Reads FOLDER/allowed again. Error: as open's; those allowed stay as they were.
  [[nodiscard]] tl::expected<void, std::string> reload();

 private:
  Gate(std::filesystem::path folder, client::Certificate own, AllowedKeys allowed);
  std::shared_ptr<const AllowedKeys> allowed() const;

  const std::filesystem::path folder_;
  const client::Certificate own_;
  mutable std::mutex mutex_;
  std::shared_ptr<const AllowedKeys> allowed_;
};

}  // namespace rustle::access
