#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "server/validation/check.h"
#include "server/validation/groups.h"

/// Groups of checks chosen by name, run one after the other.
namespace rustle::validation {

struct GroupFindings {
  const Group* group = nullptr;
  Findings findings;
};

/// The groups that a list of names asks for: a name is a group's or a check's ("table1", "table1/d_r/5-10"); none: all that
/// need nothing but the pack, and the recordings where the setting names them.
/// Error: the name that none begins with, and those there are.
[[nodiscard]] tl::expected<std::vector<const Group*>, std::string> chosen_groups(const Setting& setting,
                                                                                 const std::vector<std::string>& names);

/// Runs them and keeps the checks that are asked for; `share` is told the part done.
std::vector<GroupFindings> validate(Setting setting, const std::vector<const Group*>& chosen,
                                    const std::vector<std::string>& names, const std::function<void(double)>& share);

/// How many there are, and how many do not hold.
struct Verdict {
  std::size_t checks = 0, failed = 0;
};
Verdict verdict(const std::vector<GroupFindings>& all);

}  // namespace rustle::validation
