#include "server/spatial/hrtf.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>

namespace rustle::spatial {
namespace {

constexpr double kRadian = std::numbers::pi / 180.0;

void blend(const std::array<const float*, 4>& from, const std::array<float, 4>& share, std::size_t count,
           float* out) noexcept {
  const float *a = from[0], *b = from[1], *c = from[2], *d = from[3];
  for (std::size_t n = 0; n < count; ++n) {
    out[n] = (share[0] * a[n] + share[1] * b[n]) + (share[2] * c[n] + share[3] * d[n]);
  }
}

}  // namespace

int Hrtf::taps_at(double rate_hz) noexcept {
  return std::clamp(static_cast<int>(std::ceil(kFilter_s * rate_hz / 8)) * 8, 8, kMostTaps);
}

Vec3 Hrtf::direction(int index) noexcept {
  const double azimuth = kStep_deg * kRadian * (index % kAzimuths);
  const double elevation = kStep_deg * kRadian * (index / kAzimuths) - std::numbers::pi / 2;
  return {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth), std::sin(elevation)};
}

Hrtf::Hrtf(double rate_hz, std::span<const Response> responses) : rate_hz_(rate_hz), taps_(taps_at(rate_hz)) {
  assert(responses.size() == 2 * static_cast<std::size_t>(kDirections));
  filters_.reserve(responses.size() * static_cast<std::size_t>(taps_));
  delays_s_.reserve(responses.size());
  for (const Response& response : responses) {
    assert(response.filter.size() == static_cast<std::size_t>(taps_));
    filters_.insert(filters_.end(), response.filter.begin(), response.filter.end());
    delays_s_.push_back(response.delay_s);
  }
}

Hrtf::Place Hrtf::place(const Vec3& from_head) const noexcept {
  const double distance = norm(from_head);
  const Vec3 way = normalized(from_head, {1, 0, 0});
  const double row = (std::asin(std::clamp(way.z, -1.0, 1.0)) / kRadian + 90.0) / kStep_deg;
  const double side = std::atan2(std::abs(way.y), way.x) / (kRadian * kStep_deg);  // from ahead, 0 to kAzimuths / 2
  const int below = std::clamp(static_cast<int>(row), 0, kElevations - 2);
  const int before = std::clamp(static_cast<int>(side), 0, kAzimuths / 2 - 1);
  const auto up = static_cast<float>(row - below), on = static_cast<float>(side - before);
  const auto column = [&](int steps) { return way.y < 0 ? (kAzimuths - steps) % kAzimuths : steps; };
  const auto index = [&](int r, int steps) { return static_cast<std::uint16_t>(r * kAzimuths + column(steps)); };
  Place place;
  place.at = {index(below, before), index(below, before + 1), index(below + 1, before), index(below + 1, before + 1)};
  place.share = {(1 - up) * (1 - on), (1 - up) * on, up * (1 - on), up * on};
  place.nearness = static_cast<float>(std::min(1.0, distance / kHeadRadius_m));
  return place;
}

double Hrtf::delay_s(const Place& place, int ear) const noexcept {
  double sum = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    sum += static_cast<double>(place.share[k]) * delays_s_[2 * place.at[k] + static_cast<std::size_t>(ear)];
  }
  return sum * static_cast<double>(place.nearness);
}

void Hrtf::filter(const Place& place, int ear, std::span<float> out) const noexcept {
  assert(out.size() == static_cast<std::size_t>(taps_));
  std::array<const float*, 4> from{};
  for (std::size_t k = 0; k < 4; ++k) {
    from[k] = filters_.data() + (2 * static_cast<std::size_t>(place.at[k]) + static_cast<std::size_t>(ear)) * out.size();
  }
  blend(from, place.share, out.size(), out.data());
}

}  // namespace rustle::spatial
