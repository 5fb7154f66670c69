#pragma once

#include <string>
#include <utility>
#include <vector>

#include "server/validation/validate.h"

namespace rustle::validation {

/// One HTML page of everything: a table of figures, ours beside the paper's, and every plot. Needs nothing else. Pure.
/// `facts`: label, value.
std::string page(const std::vector<GroupFindings>& all, const std::vector<std::pair<std::string, std::string>>& facts);

/// A figure with as many digits as it needs: "0.098", "-20.02", "5930".
std::string figure_text(double value);

}  // namespace rustle::validation
