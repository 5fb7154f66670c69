#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "server/spatial/vector.h"

namespace rustle::spatial {

inline constexpr double kHeadRadius_m = 0.0875;

/// How a head alters sound on its way to the two ears, by direction: a delay against the head's centre and a short filter
/// without delay, on a grid of azimuth and elevation. Between the grid's points both are blended bilinearly, so that they
/// follow a moving source without a step. Immutable; any thread.
///
/// Head coordinates: x forward, y left, z up. Ears: 0 left, 1 right.
class Hrtf {
 public:
  static constexpr int kStep_deg = 6;
  static constexpr int kAzimuths = 360 / kStep_deg;        ///< from 0 (ahead) counter-clockwise
  static constexpr int kElevations = 180 / kStep_deg + 1;  ///< from straight below to straight above
  static constexpr int kDirections = kAzimuths * kElevations;
  static constexpr double kFilter_s = 0.0025;
  static constexpr int kMostTaps = 512;

  /// Taps of a filter at this rate: kFilter_s, a multiple of 8, at most kMostTaps.
  static int taps_at(double rate_hz) noexcept;
  /// The unit vector of a point of the grid. \pre 0 <= direction < kDirections
  static Vec3 direction(int index) noexcept;

  /// One ear's hearing of one direction.
  struct Response {
    double delay_s = 0;         ///< behind (positive) or ahead of the head's centre
    std::vector<float> filter;  ///< taps_at(rate_hz)
  };
  /// \pre responses.size() == 2 · kDirections, [direction][ear]; every filter has taps_at(rate_hz) taps
  Hrtf(double rate_hz, std::span<const Response> responses);

  double rate_hz() const noexcept { return rate_hz_; }
  int taps() const noexcept { return taps_; }

  /// A direction as four points of the grid and their shares.
  struct Place {
    std::array<std::uint16_t, 4> at{};
    std::array<float, 4> share{1, 0, 0, 0};
    float nearness = 1;  ///< of the delays: 1 from the head's radius on, towards 0 at its centre

    bool operator==(const Place&) const = default;
  };
  /// Where a source lies that is `from_head` away from the head's centre, in its coordinates and metres; the centre itself
  /// counts as ahead. [render worker]
  Place place(const Vec3& from_head) const noexcept;
  /// [render worker]
  double delay_s(const Place& place, int ear) const noexcept;
  /// The blended filter. \pre out.size() == taps() [render worker]
  void filter(const Place& place, int ear, std::span<float> out) const noexcept;

 private:
  double rate_hz_;
  int taps_;
  std::vector<float> filters_;    ///< [direction][ear][tap]
  std::vector<double> delays_s_;  ///< [direction][ear]
};

}  // namespace rustle::spatial
