#pragma once

#include <string>
#include <vector>

#include <fmt/format.h>

namespace rustle::pack {

/// What is wrong with a pack, where, and what mends it.
struct PackError {
  std::string file;   ///< the file, or the folder when the whole pack is meant
  std::string field;  ///< of pack.json, "crumpling.units[3].file"; empty when the file itself is wrong
  std::string message;
  std::string remedy;

  std::string text() const {
    return fmt::format("{}{}{}: {}{}{}", file, field.empty() ? "" : ": ", field, message, remedy.empty() ? "" : "; ",
                       remedy);
  }
};

enum class Severity { kWarning, kError };

/// One line of `rustle pack check`. A pack with an error does not load.
struct Finding {
  Severity severity = Severity::kError;
  PackError what;
};

using Findings = std::vector<Finding>;

}  // namespace rustle::pack
