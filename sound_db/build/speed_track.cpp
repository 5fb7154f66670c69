#include "sound_db/build/speed_track.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>

#include <fmt/format.h>

namespace rustle::build {

double SpeedTrack::at(double time_s) const {
  const auto after = std::upper_bound(times_s.begin(), times_s.end(), time_s) - times_s.begin();
  if (after == 0) return speeds_m_per_s.front();
  const auto right = static_cast<std::size_t>(after), left = right - 1;
  if (right == times_s.size()) return speeds_m_per_s.back();
  const double share = (time_s - times_s[left]) / (times_s[right] - times_s[left]);
  return speeds_m_per_s[left] + share * (speeds_m_per_s[right] - speeds_m_per_s[left]);
}

double SpeedTrack::fastest_m_per_s() const {
  return *std::max_element(speeds_m_per_s.begin(), speeds_m_per_s.end());
}

SpeedTrack constant_speed(double speed_m_per_s) {
  return {{0.0}, {speed_m_per_s}};
}

tl::expected<SpeedTrack, std::string> read_speed_track(const std::filesystem::path& file) {
  std::ifstream stream(file);
  if (!stream) return tl::unexpected(std::string("cannot be read"));
  constexpr int kMostLines = 10'000'000;
  SpeedTrack track;
  std::string line;
  for (int number = 1; number <= kMostLines && std::getline(stream, line); ++number) {
    const auto start = line.find_first_not_of(" \t\r");
    if (start == std::string::npos || line[start] == '#') continue;
    const char* at = line.c_str() + start;
    char* end = nullptr;
    const double time_s = std::strtod(at, &end);
    const bool has_time = end != at;
    if (!has_time && track.times_s.empty() && std::isalpha(static_cast<unsigned char>(*at))) continue;
    while (*end == ' ' || *end == '\t') ++end;
    const bool separated = *end == ',' || *end == ';';
    const char* second = separated ? end + 1 : end;
    const double speed = std::strtod(second, &end);
    if (!has_time || !separated || end == second || !std::isfinite(time_s) || !(std::abs(speed) <= 100))
      return tl::unexpected(fmt::format("line {} is not \"time,speed\" in s and m/s: {}", number, line.substr(0, 40)));
    if (!track.times_s.empty() && time_s <= track.times_s.back())
      return tl::unexpected(fmt::format("line {}: time {} s does not follow {} s", number, time_s, track.times_s.back()));
    track.times_s.push_back(time_s);
    track.speeds_m_per_s.push_back(std::abs(speed));
  }
  if (track.times_s.empty()) return tl::unexpected(std::string("holds no \"time,speed\" line"));
  return track;
}

}  // namespace rustle::build
