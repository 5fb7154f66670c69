#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include <tl/expected.hpp>

#include "client_sdk/cpp/types.h"

namespace rustle::client {

/// A CURVE key in the layout of pyzmq's certificates (zmq.auth.create_certificates): NAME.key holds the public key, for
/// others; NAME.key_secret both, for nobody else.
///
///   metadata
///       permissions = "publish listen"
///   curve
///       public-key = "Yne@$w-vo<fVvi]a<NY6T1ed:M$fCG*[IaLV{hID"
///       secret-key = "D:)Q[IlAW!ahhC2ac:9*A}h:p?([4%wOTJ%JR%cs"
struct Certificate {
  std::string public_key{};                       ///< Z85, 40 characters
  std::string secret_key{};                       ///< the same; empty: public only
  std::map<std::string, std::string> metadata{};  ///< anybody can have written it
};

/// A new pair. Error: "invalid", where ZeroMQ was built without CURVE.
[[nodiscard]] tl::expected<Certificate, Error> make_certificate();

/// The public key that belongs to a secret one, both Z85. Error: "invalid", where it is no key.
[[nodiscard]] tl::expected<std::string, Error> public_key_of(const std::string& secret_key);

/// Lines are sections, or `name = value` with or without quotes; what begins with # is left out; sections other than
/// "metadata" and "curve" are passed over. Pure.
/// Errors: "invalid", `field` the file and line: no public key, a key that is none, a secret key of another public one, a
/// name said twice, more than 64 KiB. `file` is for the error only.
[[nodiscard]] tl::expected<Certificate, Error> parse_certificate(std::string_view text, const std::string& file);
[[nodiscard]] tl::expected<Certificate, Error> read_certificate(const std::filesystem::path& file);

/// The text of a file; `secret` with the secret key.
std::string certificate_text(const Certificate& certificate, bool secret);

/// The keys of a folder: one NAME.key_secret, one's own, and server.key, the daemon's public key, which is pinned: whoever
/// answers without its secret is not talked to.
/// Errors: "invalid", where one of them is missing or no key, or several secrets are there.
[[nodiscard]] tl::expected<Keys, Error> read_keys(const std::filesystem::path& folder);

}  // namespace rustle::client
