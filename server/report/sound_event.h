#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "server/sheet/vector.h"

/// What the pictures and the page are given: plain data, SI units, filled by whoever renders.
namespace rustle::report {

using sheet::Vec2d;
using sheet::Vec3d;

enum class EventKind : std::uint8_t { kCrumpling, kFriction, kTearing };
inline constexpr int kEventKinds = 3;

/// "crumpling", "friction", "tearing".
std::string_view kind_name(EventKind kind);

struct ResonatorMark {
  bool constrained = true;
  bool coarse = false;              ///< the mesh is too coarse here for the promised accuracy
  double ruling_length_m = 0;       ///< l_r
  double free_border_length_m = 0;  ///< l_c
  double area_m2 = 0;
};

/// A crumpling event, or a whole friction or tearing episode.
struct EventMark {
  struct Speed {
    double time_s = 0;
    double speed_m_per_s = 0;
  };
  std::uint64_t id = 0;
  EventKind kind = EventKind::kCrumpling;
  std::uint32_t sheet = 0;
  double time_s = 0;     ///< simulation time
  double end_s = 0;      ///< == time_s for crumpling
  double amplitude = 0;  ///< crumpling in m (P2); friction and tearing: mean speed in m/s
  double area_m2 = 0;
  Vec3d position_m = Vec3d::Zero();
  std::vector<Speed> speeds;  ///< friction and tearing, one per frame in order of time; empty: `amplitude` throughout
  std::vector<ResonatorMark> resonators;
};

/// Interleaved PCM. Values that are not finite count as 0.
struct Sound {
  std::span<const float> samples;  ///< [frames * channels]
  int channels = 1;
  double rate_hz = 48000;
  double start_s = 0;  ///< simulation time of the first sample
  std::size_t frames() const { return channels > 0 ? samples.size() / static_cast<std::size_t>(channels) : 0; }
  double duration_s() const { return rate_hz > 0 ? static_cast<double>(frames()) / rate_hz : 0; }
  double end_s() const { return start_s + duration_s(); }
};

/// The amplitude of the reference event that fixes loudness: the flap of a 10 x 10 cm sheet (0.16 m), 0.1 m/s.
double reference_amplitude(EventKind kind);

/// 20 log10(amplitude / reference_amplitude), at least -120.
double relative_level_db(const EventMark& event);

/// Indices of the `most` events loudest against their references, loudest first, ties by id.
std::vector<std::size_t> largest_events(std::span<const EventMark> events, std::size_t most);

}  // namespace rustle::report
