#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "server/observation/observation.h"
#include "server/spatial/hrtf.h"
#include "server/spatial/receivers.h"
#include "server/synthesis/acoustic_scene.h"
#include "server/synthesis/cloth/prepared_corpus.h"
#include "server/synthesis/cue.h"
#include "server/synthesis/material.h"
#include "server/synthesis/nonblocking.h"

/// What a kind of sound consists of: a half that plans, on the analysis side, and a half that renders, on the audio side.
namespace rustle::synthesis {

/// `kPublished` repeats the papers' formulas as printed, for comparison.
enum class Mode : std::uint8_t { kPublished, kCorrected };

struct PlanOptions {
  std::uint64_t seed = 0;
  Mode mode = Mode::kCorrected;
  std::uint32_t rate_hz = 48000;
  double origin_s = 0;        ///< the time of sample 0
  bool fine_events = true;    ///< below what the mesh shows (P13); never in `published` mode
  int friction_fft_size = 0;  ///< 0: the default
  cloth::Search cloth_search = cloth::Search::kCausal;
  spatial::Layout layout = spatial::Layout::kMono;  ///< of the session: what corpora of two channels are heard through (C7)
  std::shared_ptr<const spatial::Hrtf> hrtf{};      ///< for the binaural layout, at this rate
};

/// The sample nearest to a time, held within ±2⁵² samples.
SampleTime to_sample(const PlanOptions& options, double time_s) noexcept;

/// The sheet an observation is about. What it points to outlives every cue.
struct SheetPlan {
  sheet::SheetId id = 0;
  int index = 0;                       ///< its place among the buses
  const Material* material = nullptr;  ///< on the surface it touches by default
  std::map<std::string, const Material*, std::less<>> by_surface;
  std::map<std::string, const Material*, std::less<>> partners;  ///< cloth that it touches, by that one's material (C9)
  bool fine_events = true;                                       ///< below what the mesh shows (P13)
  std::uint64_t pack_changes = 0;                                ///< how often it was given other packs
  double grammage_kg_per_m2 = pack::kDefaultGrammage_kg_per_m2;

  /// Its sounds on a touched surface; an empty or unknown name is the default.
  const Material& on(std::string_view surface) const {
    const auto found = by_surface.find(surface);
    return found == by_surface.end() ? *material : *found->second;
  }
  /// The cloth of another material that a touched surface is made of; null: none.
  const Material* partner(std::string_view surface) const {
    const auto found = partners.find(surface);
    return found == partners.end() ? nullptr : found->second;
  }
};

/// What the plan halves could not sound, or not each by itself.
struct PlanCounters {
  std::uint64_t sounds_missing = 0;   ///< the pack has no unit or spectrum for it
  std::uint64_t planes_left_out = 0;  ///< times a plane was beyond spatial::kMaxPlanes
  std::uint64_t voices_merged = 0;    ///< of dense bursts: units for which another one sounds (P9)
};

/// Plan half: observations into cues; may hold cues back until they are due. [analysis worker]
class PlanModel {
 public:
  virtual ~PlanModel() = default;
  /// `earliest`: nothing before it can be changed any more.
  virtual void plan(const SheetPlan& sheet, const observation::Observation& observation, SampleTime earliest,
                    std::vector<Cue>& out) = 0;
  /// Hands over what was held back and starts before `until`.
  virtual void release(SampleTime until, std::vector<Cue>& out) = 0;
  /// Where the listener and the planes are from now on.
  virtual void place(const spatial::Listener&, std::span<const spatial::Plane>) {}
  /// No cue of the sheet that release() does not hold back will start before this sample.
  virtual SampleTime settled(sheet::SheetId) const { return std::numeric_limits<SampleTime>::max(); }
  /// Sound before `until` is due: what waits for later observations does so no longer as far as is needed for it.
  virtual void complete(SampleTime, std::vector<Cue>&) {}
  /// No observation of this sheet will come: what sustains ends.
  virtual void end_sheet(const SheetPlan& sheet, SampleTime time, std::vector<Cue>& out) = 0;
  virtual void add_counters(PlanCounters& counters) const = 0;
  /// No sheet has the material any more, and nothing of it sounds: it is about to go.
  virtual void forget(const Material& material) = 0;
};

struct RenderOptions {
  Mode mode = Mode::kCorrected;
  std::uint32_t rate_hz = 48000;
  spatial::Layout layout = spatial::Layout::kMono;
  int max_sheets = 16;
  int max_voices = 512;
  int max_friction_sources = 128;
  int friction_fft_size = 0;                    ///< 0: the default; as in PlanOptions
  std::shared_ptr<const spatial::Hrtf> hrtf{};  ///< for the binaural layout, at this rate
  int max_tears = 16;                           ///< tips that sound at a time

  int channels() const noexcept { return spatial::channel_count(layout); }
  int buses() const noexcept { return max_sheets * kSoundKinds; }
};

class EmitterSounds;

/// One quantum of every bus, [bus][channel][kQuantum], and which buses are not silent. Samples of a silent bus mean nothing.
struct BusSamples {
  float* samples = nullptr;
  std::uint8_t* sounding = nullptr;
  int channels = 1;
  EmitterSounds* emitters = nullptr;  ///< the same quantum of every emitter by itself, where somebody listens

  /// The channel of a bus to add to; a bus first asked for becomes sounding, and all its channels zero.
  float* add_to(Bus bus, int channel) const noexcept RUSTLE_NONBLOCKING {
    float* first = samples + static_cast<std::size_t>(bus) * static_cast<std::size_t>(channels) * kQuantum;
    if (sounding[bus] == 0) std::fill_n(first, channels * kQuantum, 0.0F);
    sounding[bus] = 1;
    return first + channel * kQuantum;
  }
};

/// What the render halves play, and what they lost for want of room or because it was not finite.
struct RenderCounters {
  std::uint64_t voices = 0;           ///< units, friction sources and tears that sound now
  std::uint64_t voices_stolen = 0;    ///< faded early for a louder one
  std::uint64_t voices_dropped = 0;   ///< not begun
  std::uint64_t sources_dropped = 0;  ///< of friction and tearing: displaced or not begun
  std::uint64_t cues_dropped = 0;     ///< beyond kMaxWaitingCues, or not usable
};

/// Render half: everything is allocated by construction. [render worker]
class RenderModel {
 public:
  virtual ~RenderModel() = default;
  /// Acts on a cue at the start of the quantum about to be rendered; cues of other models are ignored.
  virtual void apply(const Cue& cue, const SceneSpan& scene, SampleTime quantum_start) noexcept RUSTLE_NONBLOCKING = 0;
  /// Adds [quantum_start, quantum_start + kQuantum) of its sound.
  virtual void render(const SceneSpan& scene, SampleTime quantum_start,
                      const BusSamples& out) noexcept RUSTLE_NONBLOCKING = 0;
  /// Nothing sounds and nothing will without a further cue.
  virtual bool silent() const noexcept RUSTLE_NONBLOCKING = 0;
  virtual void add_counters(RenderCounters& counters) const noexcept RUSTLE_NONBLOCKING = 0;
};

/// A line of the registry.
struct SoundModel {
  std::string_view name;
  SoundKind kind;
  std::unique_ptr<PlanModel> (*make_plan)(const PlanOptions&);
  std::unique_ptr<RenderModel> (*make_render)(const RenderOptions&);
};

}  // namespace rustle::synthesis
