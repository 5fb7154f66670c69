#pragma once

#include <string>
#include <string_view>
#include <tl/expected.hpp>

namespace rustle::apps {

struct TomlFault {
  unsigned line;  ///< from 1
  std::string what;
};

/// The same TOML in ASCII, without comments: letters beyond it are written as escapes in quotes. Outside of quotes they are
/// faults, and so is what is no UTF-8, a text that does not end on its line, and one of several lines, which no setting has.
/// The library, toml++ 3.3, takes some such letters for blanks that cannot be, wherever it reads them, and goes astray.
/// Pure.
tl::expected<std::string, TomlFault> ascii_toml(std::string_view text);

}  // namespace rustle::apps
