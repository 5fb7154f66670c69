#include "server/synthesis/ear_filters.h"

#include <algorithm>
#include <cassert>
#include <cstring>
#include <span>
#include <utility>

#include "server/sheet/simd.h"

namespace rustle::synthesis {
namespace {

constexpr std::size_t kLanes = 16;
using Lanes = float __attribute__((vector_size(kLanes * sizeof(float))));

/// out[n] += Σ_j h[j] x[n - j], tap after tap, for n < kQuantum + taps.
/// \pre x has kQuantum samples, and 2 kLanes zeros before and after them; taps is a multiple of 2 kLanes
RUSTLE_SIMD void add_convolved(const float* h, std::size_t taps, const float* x, float* out) noexcept {
  for (std::size_t n = 0; n < kQuantum + taps; n += 2 * kLanes) {
    const std::size_t first_tap = n < kQuantum ? 0 : n - kQuantum + 1, last_tap = std::min(taps, n + 2 * kLanes);
    Lanes a{}, b{};
    for (std::size_t j = first_tap; j < last_tap; ++j) {
      Lanes y, z;
      std::memcpy(&y, x + n - j, sizeof y);
      std::memcpy(&z, x + n - j + kLanes, sizeof z);
      a += h[j] * y;
      b += h[j] * z;
    }
    Lanes first, second;
    std::memcpy(&first, out + n, sizeof first);
    std::memcpy(&second, out + n + kLanes, sizeof second);
    first += a;
    second += b;
    std::memcpy(out + n, &first, sizeof first);
    std::memcpy(out + n + kLanes, &second, sizeof second);
  }
}

constexpr std::size_t whole_lanes(int taps) {
  return (static_cast<std::size_t>(taps) + 2 * kLanes - 1) / (2 * kLanes) * (2 * kLanes);
}

}  // namespace

EarFilters::EarFilters(std::shared_ptr<const spatial::Hrtf> hrtf, int buses)
    : hrtf_(std::move(hrtf)),
      taps_(whole_lanes(hrtf_->taps())),
      length_(kQuantum + taps_),
      filter_(taps_),
      padded_(kQuantum + 4 * kLanes),
      sums_(static_cast<std::size_t>(buses) * kEars * length_),
      quanta_left_(static_cast<std::size_t>(buses)) {}

float* EarFilters::heard(Bus bus, int ear) noexcept {
  return sums_.data() + (static_cast<std::size_t>(bus) * kEars + static_cast<std::size_t>(ear)) * length_;
}

void EarFilters::convolve(const spatial::Hrtf::Place& place, int ear, const Quantum& sound, float* out) noexcept {
  hrtf_->filter(place, ear, std::span(filter_).first(static_cast<std::size_t>(hrtf_->taps())));
  std::copy(sound.begin(), sound.end(), padded_.begin() + 2 * kLanes);
  add_convolved(filter_.data(), taps_, padded_.data() + 2 * kLanes, out);
}

void EarFilters::add(Bus bus, int ear, const spatial::Hrtf::Place& from, const spatial::Hrtf::Place& to,
                     const Quantum& sound) noexcept {
  int& left = quanta_left_[bus];
  if (left == 0) ++ringing_;
  left = static_cast<int>((length_ + kQuantum - 1) / kQuantum);
  float* out = heard(bus, ear);
  if (from == to) return convolve(to, ear, sound, out);
  Quantum leaving, coming;
  for (std::size_t n = 0; n < sound.size(); ++n) {
    coming[n] = sound[n] * (static_cast<float>(n) / kQuantum);
    leaving[n] = sound[n] - coming[n];
  }
  convolve(from, ear, leaving, out);
  convolve(to, ear, coming, out);
}

void EarFilters::render(const BusSamples& out) noexcept {
  if (ringing_ == 0) return;
  for (std::size_t bus = 0; bus < quanta_left_.size(); ++bus) {
    if (quanta_left_[bus] == 0) continue;
    for (int ear = 0; ear < static_cast<int>(kEars); ++ear) {
      float* sum = heard(static_cast<Bus>(bus), ear);
      float* samples = out.add_to(static_cast<Bus>(bus), ear);
      for (int n = 0; n < kQuantum; ++n) samples[n] += sum[n];
      std::copy(sum + kQuantum, sum + length_, sum);
      std::fill(sum + length_ - kQuantum, sum + length_, 0.0F);
    }
    if (--quanta_left_[bus] == 0) --ringing_;
  }
}

}  // namespace rustle::synthesis
