#include "server/monitor/health.h"

#include <fmt/format.h>

namespace rustle::monitor {

std::vector<std::string> problems_of(const DaemonFigures* daemon) {
  if (daemon == nullptr) return {"The network thread does not answer."};
  std::vector<std::string> problems;
  if (daemon->draining) problems.emplace_back("The daemon is ending.");
  for (const auto& session : daemon->sessions) {
    const std::string& id = session.statistics.session_id;
    if (session.behind_s > kMostBehind_s)
      problems.push_back(fmt::format("Session {}: {:.1f} s of sound are due and not rendered.", id, session.behind_s));
    if (session.analysis_stalled_s > kMostStalled_s)
      problems.push_back(
          fmt::format("Session {}: something has waited for analysis for {:.1f} s.", id, session.analysis_stalled_s));
  }
  return problems;
}

}  // namespace rustle::monitor
