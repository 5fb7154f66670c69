#include "server/validation/validate.h"

#include <fmt/format.h>

#include <algorithm>

namespace rustle::validation {
namespace {

/// Whether `name` is `asked` or lies below it.
bool below(std::string_view name, std::string_view asked) {
  return name == asked || (name.starts_with(asked) && name.substr(asked.size()).starts_with('/'));
}

bool of_group(std::string_view asked, const Group& group) {
  return below(asked, group.name);
}

}  // namespace

tl::expected<std::vector<const Group*>, std::string> chosen_groups(const Setting& setting,
                                                                   const std::vector<std::string>& names) {
  std::vector<const Group*> chosen;
  for (const auto& name : names) {
    if (std::none_of(groups().begin(), groups().end(), [&](const Group& g) { return of_group(name, g); })) {
      std::string known;
      for (const Group& group : groups()) known += fmt::format("{}{}", known.empty() ? "" : ", ", group.name);
      return tl::unexpected(fmt::format("no checks are called {}; there are: {}", name, known));
    }
  }
  for (const Group& group : groups()) {
    const bool asked =
        names.empty() || std::any_of(names.begin(), names.end(), [&](const auto& name) { return of_group(name, group); });
    if (!asked || (group.needs_recordings && setting.recordings.empty() && names.empty())) continue;
    if (group.needs_recordings && setting.recordings.empty()) {
      return tl::unexpected(
          fmt::format("{} needs recordings to compare with: name their folder with --against", group.name));
    }
    chosen.push_back(&group);
  }
  return chosen;
}

std::vector<GroupFindings> validate(Setting setting, const std::vector<const Group*>& chosen,
                                    const std::vector<std::string>& names, const std::function<void(double)>& share) {
  double total = 0, done = 0;
  for (const Group* group : chosen) total += group->weight;
  std::vector<GroupFindings> all;
  for (const Group* group : chosen) {
    setting.progress = [&, group](double part) { share((done + group->weight * part) / total); };
    Findings findings = group->run(setting);
    if (!names.empty()) {
      std::erase_if(findings.checks, [&](const Check& check) {
        return std::none_of(names.begin(), names.end(), [&](const auto& name) { return below(check.name, name); });
      });
    }
    all.push_back({group, std::move(findings)});
    done += group->weight;
    share(done / total);
  }
  return all;
}

Verdict verdict(const std::vector<GroupFindings>& all) {
  Verdict sum;
  for (const auto& group : all) {
    for (const Check& check : group.findings.checks) {
      ++sum.checks;
      if (!check.holds()) ++sum.failed;
    }
  }
  return sum;
}

}  // namespace rustle::validation
