#pragma once

#include <string>

#include <tl/expected.hpp>

#include "server/synthesis/gain.h"

/// Gains as people write them: SOUNDS=DB, where SOUNDS is "all", or by commas a kind ("crumpling", "friction", "tearing"), a
/// sheet ("sheet:2") and a material ("material:printer-paper"), as in "sheet:2,friction=-6". Pure.
namespace rustle::apps {

/// What the help of commands says of it.
inline constexpr const char* kGainSyntax =
    "SOUNDS=DB: all=-3, friction=-6, sheet:2=+3, material:printer-paper=-2, sheet:2,friction=-inf; -200 to 24, or -inf: "
    "silence";

/// Error: a sentence that quotes the text and says what was expected.
[[nodiscard]] tl::expected<synthesis::Gain, std::string> parse_gain(const std::string& text);

/// What parse_gain reads again.
std::string to_text(const synthesis::Gain& gain);

}  // namespace rustle::apps
