#pragma once

#include <string>
#include <string_view>
#include <tl/expected.hpp>

namespace rustle::apps {

struct TomlFault {
  unsigned line;  ///< from 1
  std::string what;
};

/// The text of a TOML file as toml++ can be trusted with it: without its comments, and with what is beyond ASCII in quotes
/// only. Elsewhere the library (3.3) takes some such letters for blanks that cannot be and goes astray, as it does after a
/// backslash in a text of several lines; no setting has such a text, so that these are faults, too.
tl::expected<std::string, TomlFault> careful_toml(std::string_view text);

}  // namespace rustle::apps
