#pragma once

#include <memory>
#include <string>
#include <string_view>

#include <tl/expected.hpp>

#include "server/spatial/hrtf.h"

namespace rustle::spatial {

inline constexpr std::string_view kStructuralHrtf = "structural";
inline constexpr std::string_view kKemarHrtf = "kemar";

/// libmysofa's own measurement of the KEMAR manikin, where it is installed; else empty.
std::string kemar_file();

/// What is used where nothing is said: "kemar" where it is installed, else "structural".
std::string_view default_hrtf();

/// By name: "structural" (C7), "kemar", the path of a SOFA file, or empty for the default.
/// Reads a file; takes some tenths of a second. Control side.
/// Error: a sentence that names the file or name and the remedy.
[[nodiscard]] tl::expected<std::shared_ptr<const Hrtf>, std::string> load_hrtf(std::string_view name, double rate_hz);

}  // namespace rustle::spatial
