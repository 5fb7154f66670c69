#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "client_sdk/cpp/connection.h"

namespace rustle::apps {

/// Synthetic clients that all send at once.
struct LoadCrowd {
  std::size_t sessions = 10;
  double frames_per_s = 60;
  std::size_t triangles = 1333;
  std::vector<std::string> sheets;  ///< names of sheets::loop_names(), one after another; empty: crumple and slide
};

/// More of the same for a while: `times` as many frames, of a motion as much faster.
struct LoadSurge {
  double times = 2;
  double from_s = 0, to_s = 0;
};

struct LoadOptions {
  LoadCrowd crowd;
  std::optional<LoadCrowd> heavy;  ///< others beside them, whose figures are told apart
  double seconds = 30;             ///< after a second of warming up
  double jitter_s = 0;             ///< see LoadPlan
  double withheld = 0;
  double playout_delay_s = 0.040;  ///< 0: the daemon's choice
  int blocks = 4;                  ///< in a PCM message
  double vanish_every_s = 0;       ///< so often a client is gone without a word, and another comes a second later; 0: never
  std::optional<LoadSurge> surge;
  std::string material;  ///< empty: the sessions' default
  std::uint64_t seed = 1;
};

struct LatencyFigures {
  double p50_ms = 0, p99_ms = 0, p999_ms = 0;
};

/// Of one crowd, all its sessions together.
struct CrowdFigures {
  std::size_t sessions = 0;
  std::uint64_t frames_sent = 0, frames_received = 0, frames_analysed = 0;
  std::map<std::string, std::uint64_t> dropped;  ///< by cause
  std::uint64_t deadline_misses = 0;             ///< by the daemon's own processor time
  std::uint64_t late_by_run_delay = 0;           ///< because its threads waited for a processor
  std::uint64_t pcm_gaps = 0;                    ///< that listeners met
  LatencyFigures latency;        ///< from frame() to the message in which its moment sounds, playout delay included
  double playout_delay_s = 0;    ///< the longest of a session as the daemon tells it: cloth needs more than was asked for
  double send_late_p99_ms = 0;   ///< how late the clients were themselves
  double longest_silence_s = 0;  ///< of any
  bool sums_exact = true;        ///< received = analysed + Σ dropped, and sent = received where nothing was lost on the way
};

struct LoadFigures {
  CrowdFigures crowd;
  std::optional<CrowdFigures> heavy;
  double seconds = 0;
  double cpu_s_per_session_s = 0;  ///< of the whole daemon
  std::uint64_t vanished = 0;      ///< clients
  std::uint64_t refused = 0;       ///< attachments that the daemon refused
  std::uint32_t load_level_most = 0;
  std::optional<double> full_quality_after_s;  ///< from the surge's end to load level 0
};

/// Lets the crowd play to the daemon and listen. `progress` is called with shares from 0 to 1; an interruption ends it
/// early. Error: a sentence. [control]
[[nodiscard]] tl::expected<LoadFigures, std::string> run_load(const client::Connection& connection,
                                                              const LoadOptions& options,
                                                              const std::function<void(double share)>& progress);

/// Whether everybody was served as promised: no gap, nothing dropped, no deadline missed by the daemon's own time, each
/// frame heard within 20 ms beyond the longest playout delay at p99.
[[nodiscard]] bool sustained(const LoadFigures& figures, const LoadOptions& options);

}  // namespace rustle::apps
