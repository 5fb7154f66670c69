#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "server/spatial/dipole.h"
#include "server/synthesis/cue.h"
#include "server/synthesis/dry_noise.h"
#include "server/synthesis/nonblocking.h"
#include "server/synthesis/sound_model.h"

namespace rustle::synthesis {

inline constexpr std::size_t kMostEmitters = 256;  ///< that sound at a time; what is beyond is left out and counted

/// One emitter in one quantum: its sound as heard at 1 m on its axis, without directivity, distance, reflections, ears, and
/// the limiter. A resonator of a crumpling event is an emitter, and so is a resonator of a contact as long as that slides.
struct EmitterSound {
  std::uint64_t id = 0;  ///< nothing else has it at the same time; after its end it may begin again
  Bus bus = 0;
  spatial::Vec3 position_m;  ///< at the quantum's first sample
  spatial::Vec3 normal;
  bool last = false;  ///< it has ended: its samples are zeros
  std::array<float, kQuantum> samples{};
};

/// Every emitter that sounds, each by itself, for who spatializes it elsewhere. What one sounds like and where it is,
/// spatial::paths() makes the mix's sound of it again (extended sources without reflections' blur). Made when somebody
/// listens; may come to a mixer and leave it between any two quanta.
class EmitterSounds {
 public:
  /// [control]
  explicit EmitterSounds(const RenderOptions& options);

  // ---- [render worker]

  /// Those of the last quantum, and once each that ended since the one before.
  std::span<EmitterSound> sounds() noexcept RUSTLE_NONBLOCKING { return std::span(sounds_).first(count_); }
  /// Samples for which there was no room since the last call, of every unit and source.
  std::uint64_t take_left_out() noexcept RUSTLE_NONBLOCKING { return std::exchange(left_out_, 0); }

  // ---- [render worker] for the mixer

  void begin_quantum() noexcept RUSTLE_NONBLOCKING;
  void end_quantum() noexcept RUSTLE_NONBLOCKING;

  // ---- [render worker] for its models

  /// The quantum's samples of an emitter, to add to; where several add, the first says where it is. Null: there is no room,
  /// which is counted.
  float* add_to(std::uint64_t id, Bus bus, const spatial::Emitter& emitter) noexcept RUSTLE_NONBLOCKING;
  DryNoise& noise() noexcept RUSTLE_NONBLOCKING { return noise_; }

 private:
  static constexpr std::size_t kTable = 4 * kMostEmitters;
  static constexpr std::uint16_t kFree = 0xffff;

  /// Where in the table the id is, or would go.
  std::size_t place_of(std::uint64_t id) const noexcept;
  void fill_table() noexcept;

  std::vector<EmitterSound> sounds_;
  std::vector<std::uint8_t> added_;   ///< by sound: something of it in this quantum
  std::vector<std::uint16_t> table_;  ///< open addressing, by id: index of the sound
  std::size_t count_ = 0;
  std::uint64_t left_out_ = 0;
  DryNoise noise_;
};

}  // namespace rustle::synthesis
