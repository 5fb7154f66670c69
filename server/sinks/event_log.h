#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "server/observation/observation.h"

namespace rustle::sinks {

/// One line of an event list: a crumpling event, or a whole episode of friction or tearing.
struct LoggedEvent {
  enum class Kind { kCrumpling, kFriction, kTearing };
  std::uint64_t id = 0;
  double time_s = 0;  ///< crumpling: the interpolated zero of H; else when the episode began
  double end_s = 0;   ///< crumpling: the frame that confirmed it; else when the episode ended
  sheet::SheetId sheet = 0;
  Kind kind = Kind::kCrumpling;
  std::uint64_t continues = 0;  ///< 0: none
  double amplitude = 0;         ///< crumpling: m; else the time mean of the speed, m/s
  double area_m2 = 0;           ///< of an episode: at its loudest
  sheet::Vec3d position_m = sheet::Vec3d::Zero();
  std::vector<std::uint32_t> vertices;
  observation::Source source = observation::Source::kDetected;
  double speed_m_per_s = 0;  ///< of an episode: its greatest; of a crumpling event: the sheet's there
  sheet::Vec3d direction = sheet::Vec3d::Zero();
  std::vector<observation::Resonator> resonators;
  double torn_m = 0;  ///< tearing: the length of the tear that the tip made
  struct Speed {
    double time_s, speed_m_per_s;
    sheet::Vec3d position_m;
  };
  std::vector<Speed> speeds;  ///< of an episode, one per frame; in the JSON of tearing only
};

const char* name_of(LoggedEvent::Kind kind);

/// Turns observations into an event list. A contact that never slides faster than 1 mm/s is no friction event.
class EventLog {
 public:
  void add(const observation::Observation& observed);
  /// Ends the episodes that still go on, and returns everything in the order of time.
  std::vector<LoggedEvent> finish();

 private:
  struct Episode {
    LoggedEvent event;
    double speed_seconds = 0;
    double last_s = 0;
    bool slid = false;
  };
  using EpisodeKey = std::pair<sheet::SheetId, std::uint64_t>;
  void follow(std::map<EpisodeKey, Episode>& episodes, const observation::Observation& observed, LoggedEvent now);
  void retire(std::map<EpisodeKey, Episode>& episodes, const observation::Observation& observed);
  void close(Episode& episode);

  std::map<EpisodeKey, Episode> friction_, tears_;
  std::vector<LoggedEvent> events_;
};

/// One JSON object, without a line break: {"id","time_s","end_s","sheet","kind","continues","amplitude",
/// "amplitude_unit","area_m2","position_m","vertices","source","speed_m_per_s","direction","resonators"}; of tearing also
/// "torn_m" and "track", the tip frame by frame: [[time_s, speed_m_per_s, x, y, z], ...].
std::string json_line(const LoggedEvent& event);

/// Writes one line per event. Error: a sentence with the file name and what to do.
[[nodiscard]] tl::expected<void, std::string> write_json_lines(const std::filesystem::path& file,
                                                               const std::vector<LoggedEvent>& events);

}  // namespace rustle::sinks
