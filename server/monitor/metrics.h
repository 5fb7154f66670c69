#pragma once

#include <string>

#include "server/monitor/figures.h"
#include "server/monitor/process.h"

namespace rustle::monitor {

/// Everything as Prometheus reads it (text format 0.0.4): sums over all sessions that ever were, then each session that is
/// there, by its id. Pure.
[[nodiscard]] std::string metrics_text(const DaemonFigures& daemon, const ProcessFigures& process);

}  // namespace rustle::monitor
