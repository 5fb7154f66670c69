#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <tl/expected.hpp>

namespace rustle::build {

/// Sliding speed over the time of a recording (An et al. 2012, s(t)): straight between its points, constant before the first
/// and after the last.
struct SpeedTrack {
  std::vector<double> times_s;  ///< rising
  std::vector<double> speeds_m_per_s;
  double at(double time_s) const;
  double fastest_m_per_s() const;
};

SpeedTrack constant_speed(double speed_m_per_s);

/// A CSV file of `time,speed` in s and m/s, one point a line; a first line of words and lines beginning with # are left
/// alone. Error: what is wrong, with the line.
[[nodiscard]] tl::expected<SpeedTrack, std::string> read_speed_track(const std::filesystem::path& file);

}  // namespace rustle::build
