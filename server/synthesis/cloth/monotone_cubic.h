#pragma once

#include <array>
#include <cstddef>
#include <span>

namespace rustle::cloth {

/// Neighbouring samples of a track: the interval from `at[1]` to `at[2]`, the sample before it and the one after it.
struct TrackInterval {
  std::array<double, 4> at{};          ///< rising, in any unit of time
  std::array<double, 4> value{};       ///< at those
  bool before = false, after = false;  ///< whether at[0] and at[3] are there
};

/// Monotone cubic Hermite interpolation within an interval (Fritsch and Butland 1984, as PCHIP): slopes are weighted
/// harmonic means of the neighbouring secants, 0 at an extremum, and those of a parabola at an end of the track. It goes
/// through the samples, has one continuous derivative, never leaves the range of the two samples, and is 0 where both are
/// (C1). Held at the samples outside of the interval. Pure, allocates nothing.
double monotone_cubic(const TrackInterval& interval, double at) noexcept;

}  // namespace rustle::cloth
