#pragma once

#include <string>
#include <vector>

#include "server/monitor/figures.h"

namespace rustle::monitor {

inline constexpr double kMostBehind_s = 0.5;  ///< of a live session's rendering
inline constexpr double kMostStalled_s = 5;   ///< of analysis, while something waits

/// What is wrong with the daemon, a sentence each; none: it is well. `daemon` null: its network thread does not answer.
/// Pure.
[[nodiscard]] std::vector<std::string> problems_of(const DaemonFigures* daemon);

}  // namespace rustle::monitor
