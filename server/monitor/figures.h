#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "server/session/duration_histogram.h"
#include "server/session/frame_trace.h"
#include "server/sinks/playback.h"
#include "server/wire/control.h"

/// What the daemon's network thread tells of it when it is asked. Plain data.
namespace rustle::monitor {

/// How long stages took, by the members of session::StageTimes.
struct StageCounts {
  session::DurationHistogram::Counts decode, wait, analysis, hand_over, render, sound;
  StageCounts& operator+=(const StageCounts& other);
};
StageCounts counts_of(const session::StageTimes& times);

/// Lengths in seconds of what wire::Statistics tells in samples, since sessions have rates of their own.
struct GapLengths {
  double pcm_s = 0;
  double input_s = 0;
};

struct SessionFigures {
  wire::Statistics statistics;
  std::string name;  ///< for people
  bool live = false;
  bool ended = false;  ///< its stream has ended; its figures are kept for a while
  std::uint32_t rate_hz = 0;
  std::size_t sheets = 0;
  std::uint64_t frames_waiting = 0;
  double behind_s = 0;            ///< live: sound that is due and not rendered
  double analysis_stalled_s = 0;  ///< for so long something has waited while nothing was taken up
  StageCounts stages;

  GapLengths gaps() const {
    return {static_cast<double>(statistics.samples_in_gaps) / rate_hz,
            static_cast<double>(statistics.samples_in_input_gaps) / rate_hz};
  }
};

/// Sums over sessions. Of `statistics` only what counts up has a meaning.
struct Totals {
  std::uint64_t sessions = 0;
  wire::Statistics statistics;
  GapLengths gaps;
  StageCounts stages;

  void add(const SessionFigures& session);
};

/// Of a daemon that is one of a fleet: what the sidecar beside it says, and how that was spoken to.
struct FleetFigures {
  bool reachable = false;  ///< the sidecar answers
  std::string game_server, state, address;
  std::map<std::string, std::uint16_t> ports;                          ///< of the node, by name
  std::map<std::pair<std::string, std::string>, std::uint64_t> asked;  ///< by what, and "done", "refused" or "unreachable"
};

/// Of the daemon's page.
struct PageFigures {
  std::uint64_t viewers = 0;          ///< there now
  std::uint64_t viewers_refused = 0;  ///< too many were there
  std::uint64_t frames_taken = 0;     ///< that analysis handed over to be shown
  std::uint64_t messages_lost = 0;    ///< of viewers that read too slowly and are gone
};

struct DaemonFigures {
  std::string version;
  double up_s = 0;
  bool draining = false;  ///< it ends
  std::size_t sessions_most = 0;
  std::uint64_t malformed_messages = 0;
  std::uint64_t unsent_replies = 0;
  std::vector<SessionFigures> sessions;
  Totals departed;  ///< of sessions that are no longer there
  std::optional<sinks::PlaybackFigures> playback;
  std::optional<FleetFigures> fleet;  ///< absent: it is in none
  std::optional<PageFigures> page;

  /// Of all sessions that ever were.
  Totals totals() const;
};

/// The newest frames of one session.
struct SessionTraces {
  std::string session;
  bool live = false;
  std::int64_t clock_ns = 0;  ///< the session clock's time when they were read
  std::vector<session::FrameTrace> frames;
};

}  // namespace rustle::monitor
