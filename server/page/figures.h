#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "server/session/duration_histogram.h"
#include "server/synthesis/gain.h"

/// What the network thread tells the page, four times a second while somebody looks. Plain data.
namespace rustle::page {

/// What somebody may do with a session.
struct Rights {
  bool listen = false;
  bool change = false;
  bool operator==(const Rights&) const = default;
};

/// How loud a session was since the last figures: of the sum that its listeners hear.
struct Level {
  float peak = 0;
  double squares = 0;  ///< sum
  std::uint64_t samples = 0;
};

struct SessionFigures {
  std::string id, name;
  bool live = false;
  bool ended = false;
  std::uint32_t rate_hz = 0;
  int channels = 0;
  std::size_t sheets = 0;
  std::uint64_t voices = 0;
  std::uint64_t frames_received = 0, frames_analysed = 0;
  std::map<std::string, std::uint64_t> frames_dropped;  ///< by cause
  double playout_delay_s = 0;
  Level level;
  std::vector<synthesis::Gain> gains;  ///< in force
};

struct Figures {
  double up_s = 0;
  std::uint32_t load_level = 0;
  std::uint64_t pcm_gaps = 0;                         ///< of all sessions
  session::DurationHistogram::Counts sound;           ///< received to sent, beyond the playout delay, of all live sessions
  std::vector<SessionFigures> sessions;               ///< by id
  std::map<std::string, std::vector<Rights>> rights;  ///< by user, of each of these sessions
};

}  // namespace rustle::page
