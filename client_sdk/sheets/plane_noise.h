#pragma once

#include <cstdint>

namespace rustle::sheets {

/// A number in [0, 1) that depends on the seed and two integers and on nothing else (SplitMix64; Steele, Lea, Flood 2014).
[[nodiscard]] double hashed_unit(std::uint64_t seed, std::int64_t a, std::int64_t b);

/// Gradient noise over the plane (Perlin 2002), features about one unit wide: between 0 and 1, mean ½, two continuous
/// derivatives. Pure.
[[nodiscard]] double perlin_noise(std::uint64_t seed, double x, double y);

}  // namespace rustle::sheets
