#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "server/synthesis/acoustic_scene.h"
#include "server/synthesis/cue.h"
#include "server/synthesis/nonblocking.h"
#include "server/synthesis/sound_model.h"

namespace rustle::synthesis {

inline constexpr int kMaxWaitingCues = 4096;

/// Cues in, samples of every bus out, a quantum at a time.
///
///   cues ─► waiting, by start ─► scene (listener, planes) ─┐
///                            └─► every model's render half ─┼─► buses ────┬─► bus gains ─► out
///                                                           └─► emitters ─┘   (emitters only where somebody listens)
///
/// What is rendered depends on the cues and on the quanta alone: a cue acts in the quantum that holds its start, however
/// early it was applied, and cues of one quantum act in an order of their own (start, bus, kind, event). A cue that comes
/// after its quantum acts in the next. Everything is allocated by construction.
class Mixer {
 public:
  /// [control]
  explicit Mixer(const RenderOptions& options);
  ~Mixer();

  int channels() const noexcept { return options_.channels(); }
  int buses() const noexcept { return options_.buses(); }
  /// Buses before this one have been named by a cue; those from here on have never sounded.
  int buses_told_of() const noexcept { return static_cast<int>(told_of_); }
  /// Floats of one quantum: buses · channels · kQuantum.
  std::size_t quantum_size() const noexcept;

  /// Takes a cue in; memory that it points to must live as long as the mixer. Cues that name a bus or slot that is not
  /// there, and those beyond kMaxWaitingCues, are dropped and counted. [render worker]
  void apply(const Cue& cue) noexcept RUSTLE_NONBLOCKING;

  /// Renders [quantum_start, quantum_start + kQuantum) of every bus into out, [bus][channel][kQuantum]. A bus that does not
  /// sound is left as it was. Every emitter by itself goes to `emitters` as well, where given, and changes nothing in out.
  /// [render worker]
  /// \pre quantum_start is a multiple of kQuantum and follows the last one; out.size() == quantum_size()
  void render(SampleTime quantum_start, std::span<float> out, EmitterSounds* emitters = nullptr) noexcept RUSTLE_NONBLOCKING;

  /// Whether the quantum just rendered has anything in this bus; if not, its samples mean nothing. [render worker]
  bool sounding(Bus bus) const noexcept RUSTLE_NONBLOCKING { return sounding_[bus] != 0; }

  /// Nothing sounds and nothing will without a further cue. [render worker]
  bool silent() const noexcept RUSTLE_NONBLOCKING;

  /// [render worker]
  RenderCounters counters() const noexcept RUSTLE_NONBLOCKING;

 private:
  void act(const Cue& cue, SampleTime quantum_start) noexcept;
  void act_on_due(SampleTime quantum_start) noexcept;
  /// A bus's gain at each sample of a quantum.
  using Factors = std::array<float, kQuantum>;
  void fill_factors(std::size_t bus, SampleTime quantum_start, Factors& factors) const noexcept;
  void apply_gains(SampleTime quantum_start, std::span<float> out) noexcept;
  void apply_gains(SampleTime quantum_start, EmitterSounds& emitters) const noexcept;

  /// A bus's gain: a way, flat at both ends, and what it goes to after that.
  struct BusGain {
    Ramp<float> way{0, 0, 1, 1};
    std::optional<GainCue> next;
  };

  RenderOptions options_;
  SceneTrack scene_;
  std::vector<std::unique_ptr<RenderModel>> models_;
  std::vector<Cue> waiting_;  ///< capacity kMaxWaitingCues
  std::vector<Cue> due_;      ///< the same, of the quantum about to be rendered
  int sounds_waiting_ = 0;
  std::vector<BusGain> gains_;
  std::size_t told_of_ = 0;  ///< no cue has been for this bus or one after it
  std::vector<std::uint8_t> sounding_;
  std::uint64_t dropped_ = 0;
};

}  // namespace rustle::synthesis
