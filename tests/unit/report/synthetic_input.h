#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "server/report/sheet_picture.h"
#include "server/report/sound_event.h"

namespace rustle::report {

/// A sine of magnitude `amplitude`, interleaved.
inline std::vector<float> tone(double hz, double amplitude, double seconds, double rate_hz, int channels = 1) {
  std::vector<float> samples;
  for (int i = 0; i < static_cast<int>(seconds * rate_hz); ++i) {
    for (int c = 0; c < channels; ++c) {
      samples.push_back(static_cast<float>(amplitude * std::sin(2 * std::numbers::pi * hz * i / rate_hz)));
    }
  }
  return samples;
}

inline EventMark crumple(std::uint64_t id, double time_s, double amplitude_m) {
  EventMark event;
  event.id = id;
  event.time_s = event.end_s = time_s;
  event.amplitude = amplitude_m;
  event.area_m2 = 0.002;
  event.resonators.push_back({false, false, 0.1, 0.25, 0.002});
  return event;
}

inline EventMark rub(std::uint64_t id, double from_s, double to_s, double speed_m_per_s) {
  EventMark event;
  event.id = id;
  event.kind = EventKind::kFriction;
  event.time_s = from_s;
  event.end_s = to_s;
  event.amplitude = speed_m_per_s;
  event.resonators.push_back({true, false, 0.08, 0, 0.001});
  return event;
}

/// An A4 sheet rolled around y, of nx * ny * 2 triangles: left half region 0, right half region 1.
inline SheetView rolled_sheet(int nx, int ny) {
  SheetView view;
  for (int j = 0; j <= ny; ++j) {
    for (int i = 0; i <= nx; ++i) {
      const float x = 0.297f * static_cast<float>(i) / static_cast<float>(nx);
      const float y = 0.210f * static_cast<float>(j) / static_cast<float>(ny);
      view.positions_m.push_back({0.1f * std::sin(x / 0.1f), y, 0.1f * (1 - std::cos(x / 0.1f))});
      view.material_coordinates_m.push_back({x, y});
    }
  }
  for (int j = 0; j < ny; ++j) {
    for (int i = 0; i < nx; ++i) {
      const auto a = static_cast<std::uint32_t>(j * (nx + 1) + i), b = a + 1, d = a + static_cast<std::uint32_t>(nx) + 1,
                 c = d + 1;
      view.triangles.push_back({a, b, c});
      view.triangles.push_back({a, c, d});
      for (int k = 0; k < 2; ++k) {
        view.triangle_regions.push_back(i < nx / 2 ? 0u : 1u);
        view.curvature_per_m.push_back(10);
      }
    }
  }
  view.region_curved = {true, true};
  return view;
}

}  // namespace rustle::report
