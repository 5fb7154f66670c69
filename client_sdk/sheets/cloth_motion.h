#pragma once

#include <memory>

#include "client_sdk/sheets/animated_sheet.h"

/// Cloth on a table that is rubbed over it and crumpled: it slides where it touches, and wrinkles that run along it turn its
/// curvature over from place to place. Cloth stretches: lengths change by 2 % at the most.
namespace rustle::sheets {

inline constexpr double kClothWidth_m = 0.6, kClothHeight_m = 0.45;

/// A demonstration of nine seconds: the cloth is pushed to and fro, first slowly, then in fast strokes; lies still while
/// wrinkles run along it, small ones and large ones; and is pulled away. The mesh is Delaunay; the same arguments give the
/// same bits.
[[nodiscard]] std::unique_ptr<AnimatedSheet> make_cloth_demo(std::size_t triangle_count = 1333, std::uint64_t seed = 1);

inline constexpr double kRubbingPeriod_s = 1.2;

/// Rubbed to and fro all the time, at 0.6 m/s at most, wrinkles running along: the same after each kRubbingPeriod_s.
[[nodiscard]] std::unique_ptr<AnimatedSheet> make_rubbed_cloth(SheetMesh mesh);

}  // namespace rustle::sheets
