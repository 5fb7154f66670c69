#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "server/spatial/hrtf.h"
#include "server/synthesis/cue.h"
#include "server/synthesis/nonblocking.h"
#include "server/synthesis/sound_model.h"

namespace rustle::synthesis {

/// Sounds from directions into two ears: each quantum of a sound is convolved with the ear's filter for where it comes from
/// and added, with what rings on after it, to the sound of its bus. What comes from somewhere else at the quantum's end
/// than at its start goes over from one filter to the other sample by sample, so nothing steps, and filters have no state
/// of their own. Delays are the caller's. Everything is allocated by construction. [render worker]
class EarFilters {
 public:
  using Quantum = std::array<float, kQuantum>;

  /// [control] \pre hrtf is not null
  EarFilters(std::shared_ptr<const spatial::Hrtf> hrtf, int buses);

  const spatial::Hrtf& hrtf() const noexcept { return *hrtf_; }

  /// Adds a quantum that comes from `from` at its start and from `to` at its end.
  void add(Bus bus, int ear, const spatial::Hrtf::Place& from, const spatial::Hrtf::Place& to,
           const Quantum& sound) noexcept RUSTLE_NONBLOCKING;

  /// Hands out the quantum that was added to, of every bus, and moves on.
  void render(const BusSamples& out) noexcept RUSTLE_NONBLOCKING;

  /// Nothing rings any more.
  bool silent() const noexcept RUSTLE_NONBLOCKING { return ringing_ == 0; }

 private:
  static constexpr std::size_t kEars = 2;

  float* heard(Bus bus, int ear) noexcept;
  void convolve(const spatial::Hrtf::Place& place, int ear, const Quantum& sound, float* out) noexcept;

  std::shared_ptr<const spatial::Hrtf> hrtf_;
  std::size_t taps_;              ///< a multiple of the lanes
  std::size_t length_;            ///< of what a quantum becomes: kQuantum + taps_
  std::vector<float> filter_;     ///< [taps_]
  std::vector<float> padded_;     ///< the sound between zeros
  std::vector<float> sums_;       ///< [bus][ear][length_]
  std::vector<int> quanta_left_;  ///< by bus: that still sound
  int ringing_ = 0;               ///< buses that do
};

}  // namespace rustle::synthesis
