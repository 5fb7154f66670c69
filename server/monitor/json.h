#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "server/monitor/figures.h"
#include "server/monitor/process.h"

/// What the daemon tells as JSON. Pure.
namespace rustle::monitor {

/// Daemon, its sums and every session, with the names of session.proto's Statistics.
[[nodiscard]] std::string figures_json(const DaemonFigures& daemon, const ProcessFigures& process);

/// Which frames of a session; all that are kept where nothing is said.
struct TraceChoice {
  std::optional<std::uint64_t> frame;     ///< by its number among the session's frames, from 1
  std::optional<std::uint64_t> sequence;  ///< by its message's
  std::size_t newest = 32;                ///< at most so many, the newest
};

/// Frames from the oldest to the newest. Stations in milliseconds since receipt, null where a frame has not passed;
/// `unix_now` belongs to traces.clock_ns.
[[nodiscard]] std::string trace_json(const SessionTraces& traces, const TraceChoice& choice,
                                     std::chrono::duration<double> unix_now);

}  // namespace rustle::monitor
