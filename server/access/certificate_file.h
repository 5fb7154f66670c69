#pragma once

#include <filesystem>

#include <tl/expected.hpp>

#include "client_sdk/cpp/certificate.h"

namespace rustle::access {

/// Writes beside the place, syncs, and puts it there: readers see the old file or the new one. A secret is for its owner
/// only (mode 0600). Error: "invalid" with the system's reason.
[[nodiscard]] tl::expected<void, client::Error> write_certificate(const std::filesystem::path& file,
                                                                  const client::Certificate& certificate, bool secret);

}  // namespace rustle::access
