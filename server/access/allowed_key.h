#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include <tl/expected.hpp>

#include "client_sdk/cpp/certificate.h"

/// Who may use a daemon, and for what.
namespace rustle::access {

struct Permissions {
  bool publish = false;  ///< attach sessions and send their streams; hear and change one's own
  bool listen = false;   ///< hear every session, and see who is there
  bool admin = false;    ///< both, and change, record and end any session, and have packs read anew

  bool may_publish() const { return publish || admin; }
  bool may_listen() const { return listen || admin; }
  bool operator==(const Permissions&) const = default;
};

/// Of all sessions of a key together, but for voices. 0: as much as the daemon has.
struct Quotas {
  std::uint64_t sessions = 0;
  std::uint64_t triangles = 0;     ///< of the meshes in use
  std::uint64_t bytes_per_s = 0;   ///< of its stream; up to half a second's worth may come at once
  std::uint64_t frames_per_s = 0;  ///< the same
  std::uint64_t voices = 0;        ///< of each session, at most 512

  bool operator==(const Quotas&) const = default;
};

struct AllowedKey {
  std::string name;        ///< the file's stem
  std::string public_key;  ///< Z85
  Permissions permissions;
  Quotas quotas;

  bool operator==(const AllowedKey&) const = default;
};

/// A key as FOLDER/allowed/NAME.key has it: a public certificate whose metadata says what it may.
///
///   metadata
///       permissions = "publish listen"
///       sessions = "4"
///   curve
///       public-key = "..."
///
/// Error: a sentence with file and remedy: a permission or quota that is not known, no permission, a number that is none.
[[nodiscard]] tl::expected<AllowedKey, std::string> allowed_key(const client::Certificate& certificate,
                                                                const std::filesystem::path& file);
client::Certificate certificate_of(const AllowedKey& key);

/// "publish listen". Nothing: "none".
std::string text_of(const Permissions& permissions);
/// Every quota with its name in the file.
std::vector<std::pair<std::string_view, std::uint64_t Quotas::*>> quota_list();

/// A plain file name: 1 to 64 letters, digits, dots, dashes or underscores, not beginning with a dot.
bool is_key_name(std::string_view name);

/// The keys that may connect, by public key. Immutable once read; any thread.
class AllowedKeys {
 public:
  /// Reads FOLDER/allowed; a folder without it allows nobody. All or nothing.
  /// Error: a sentence with file and remedy; two names of one key is one.
  [[nodiscard]] static tl::expected<AllowedKeys, std::string> read(const std::filesystem::path& folder);

  /// Null: not allowed.
  const AllowedKey* find(const std::string& public_key) const;
  const AllowedKey* named(std::string_view name) const;
  const std::map<std::string, AllowedKey>& all() const { return keys_; }

 private:
  std::map<std::string, AllowedKey> keys_;
};

/// Where a key of this name stands.
std::filesystem::path allowed_file(const std::filesystem::path& folder, std::string_view name);

}  // namespace rustle::access
