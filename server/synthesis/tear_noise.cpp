#include "server/synthesis/tear_noise.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "server/synthesis/emitter_sounds.h"
#include "server/synthesis/source_paths.h"
#include "server/synthesis/tear_source.h"

namespace rustle::synthesis {
namespace {

bool finite(const spatial::Vec3& v) noexcept {
  return std::isfinite(v.x + v.y + v.z);
}

bool finite(const TearCue& cue) noexcept {
  return std::isfinite(cue.gain) && std::isfinite(cue.speed_m_per_s) && finite(cue.emitter.position_m) &&
         finite(cue.emitter.normal) && std::isfinite(cue.emitter.cosine_floor);
}

class TearNoise final : public RenderModel {
 public:
  explicit TearNoise(const RenderOptions& options) : paths_(options) {
    sources_.reserve(static_cast<std::size_t>(options.max_tears));
    for (int k = 0; k < options.max_tears; ++k) sources_.emplace_back(options.mode, options.rate_hz);
  }

  void apply(const Cue& any, const SceneSpan&, SampleTime quantum_start) noexcept override {
    const auto* cue = std::get_if<TearCue>(&any);
    if (!cue) return;
    if (!finite(*cue)) {
      ++unusable_;
      return;
    }
    TearSource* source = find(cue->tip);
    if (!source) {
      if (cue->ends || cue->speed_m_per_s <= 0) return;
      source = room();
      if (!source) {
        ++dropped_;
        return;
      }
      source->begin(*cue, quantum_start);
    }
    source->apply(*cue, quantum_start);
  }

  void render(const SceneSpan& scene, SampleTime quantum_start, const BusSamples& out) noexcept override {
    for (TearSource& source : sources_) {
      if (!source.active()) continue;
      source.make(quantum_start);
      if (!source.sounding()) continue;
      if (out.emitters) give_off(source, quantum_start, *out.emitters);
      paths_.spread(source.past(), source.bus(), source.emitter(quantum_start), source.emitter(quantum_start + kQuantum),
                    scene, quantum_start, out);
    }
    paths_.finish(out);
  }

  bool silent() const noexcept override { return std::ranges::none_of(sources_, &TearSource::sounding) && paths_.silent(); }

  void add_counters(RenderCounters& counters) const noexcept override {
    counters.voices += static_cast<std::uint64_t>(std::ranges::count_if(sources_, &TearSource::sounding));
    counters.sources_dropped += dropped_;
    counters.cues_dropped += unusable_;
  }

 private:
  TearSource* find(std::uint64_t tip) noexcept {
    for (TearSource& source : sources_) {
      if (source.active() && source.tip() == tip) return &source;
    }
    return nullptr;
  }

  /// A free source, else one whose tip rests.
  TearSource* room() noexcept {
    const auto free = std::ranges::find_if_not(sources_, &TearSource::active);
    if (free != sources_.end()) return &*free;
    const auto resting = std::ranges::find_if_not(sources_, &TearSource::sounding);
    if (resting == sources_.end()) return nullptr;
    resting->stop();
    return &*resting;
  }

  /// The source by itself, as the direct path brings it.
  static void give_off(const TearSource& source, SampleTime quantum_start, EmitterSounds& emitters) noexcept {
    float* samples = emitters.add_to(source.tip(), source.bus(), source.emitter(quantum_start));
    if (!samples) return;
    std::array<float, kQuantum> sound;
    source.past().read(quantum_start - kPathLag, sound);
    for (std::size_t n = 0; n < sound.size(); ++n) samples[n] += sound[n];
  }

  std::vector<TearSource> sources_;
  SourcePaths paths_;
  std::uint64_t dropped_ = 0;
  std::uint64_t unusable_ = 0;
};

}  // namespace

std::unique_ptr<RenderModel> make_tear_noise(const RenderOptions& options) {
  return std::make_unique<TearNoise>(options);
}

}  // namespace rustle::synthesis
