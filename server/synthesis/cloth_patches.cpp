#include "server/synthesis/cloth_patches.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "server/synthesis/emitter_sounds.h"
#include "server/synthesis/source_paths.h"

namespace rustle::synthesis {
namespace {

constexpr double kLatestImage_s = 0.010;

bool finite(const ClothPieceCue& cue) noexcept {
  const spatial::Vec3 &p = cue.emitter.position_m, &n = cue.emitter.normal;
  return std::isfinite(cue.gain) && std::isfinite(p.x + p.y + p.z) && std::isfinite(n.x + n.y + n.z) &&
         std::isfinite(cue.emitter.cosine_floor);
}

/// One patch: the pieces that it plays, and where it is.
class ClothPatch {
 public:
  explicit ClothPatch(std::uint32_t rate_hz) : past_(SourcePaths::past_samples(rate_hz)) {}

  bool active() const noexcept { return active_; }
  std::uint64_t id() const noexcept { return id_; }
  Bus bus() const noexcept { return bus_; }
  std::int8_t channel() const noexcept { return channel_; }
  const SoundPast& past() const noexcept { return past_; }
  spatial::Emitter emitter(SampleTime time) const noexcept { return between(way_.from, way_.to, way_.progress(time)); }

  void begin(const ClothPieceCue& cue, SampleTime quantum_start) noexcept {
    active_ = true;
    id_ = cue.patch;
    bus_ = cue.bus;
    channel_ = cue.channel;
    count_ = 0;
    way_ = {quantum_start, quantum_start, cue.emitter, cue.emitter};
    past_.clear();
    heard_until_ = quantum_start;
  }

  /// False: it plays as many pieces as it can.
  bool apply(const ClothPieceCue& cue, SampleTime quantum_start) noexcept {
    if (count_ == pieces_.size()) return false;
    pieces_[count_++] = {cue.samples, cue.first, cue.first + cue.count, cue.gain};
    // The emitter comes when what is made now is heard.
    way_ = {quantum_start, std::max(cue.until, quantum_start), emitter(quantum_start), cue.emitter};
    return true;
  }

  /// Makes what is heard kPathLag after the quantum.
  void make(SampleTime quantum_start) noexcept {
    const auto out = past_.quantum(quantum_start);
    std::ranges::fill(out, 0.0F);
    const SampleTime first = quantum_start + kPathLag;
    std::size_t kept = 0;
    for (std::size_t k = 0; k < count_; ++k) {
      const Playing piece = pieces_[k];
      const SampleTime from = std::max(piece.first, first), to = std::min(piece.end, first + kQuantum);
      for (SampleTime n = from; n < to; ++n)
        out[static_cast<std::size_t>(n - first)] += piece.gain * piece.samples[n - piece.first];
      if (piece.end > first + kQuantum) pieces_[kept++] = piece;
    }
    if (count_ > 0) heard_until_ = quantum_start + kQuantum;
    count_ = kept;
    if (quantum_start > heard_until_ + past_.reach()) active_ = false;
  }

 private:
  struct Playing {
    const float* samples = nullptr;
    SampleTime first = 0, end = 0;
    float gain = 0;
  };

  bool active_ = false;
  std::uint64_t id_ = 0;
  Bus bus_ = 0;
  std::int8_t channel_ = kEveryChannel;
  std::array<Playing, 16> pieces_;
  std::size_t count_ = 0;
  Ramp<spatial::Emitter> way_;
  SoundPast past_;
  SampleTime heard_until_ = 0;  ///< nothing was made from there on
};

class ClothPatches final : public RenderModel {
 public:
  explicit ClothPatches(const RenderOptions& options) : channels_(options.channels()), paths_(options) {
    patches_.reserve(kMostClothPatches);
    for (std::size_t k = 0; k < kMostClothPatches; ++k) patches_.emplace_back(options.rate_hz);
  }

  void apply(const Cue& any, const SceneSpan&, SampleTime quantum_start) noexcept override {
    const auto* cue = std::get_if<ClothPieceCue>(&any);
    if (!cue) return;
    if (!finite(*cue) || !cue->samples) {
      ++unusable_;
      return;
    }
    ClothPatch* patch = find(cue->patch);
    if (!patch) {
      const auto free = std::ranges::find_if_not(patches_, &ClothPatch::active);
      if (free == patches_.end()) {
        ++dropped_;
        return;
      }
      patch = &*free;
      patch->begin(*cue, quantum_start);
      ++active_;
    }
    if (!patch->apply(*cue, quantum_start)) ++unusable_;
  }

  void render(const SceneSpan& scene, SampleTime quantum_start, const BusSamples& out) noexcept override {
    if (active_ > 0) {
      for (ClothPatch& patch : patches_) {
        if (patch.active()) render(patch, scene, quantum_start, out);
      }
    }
    paths_.finish(out);
  }

  bool silent() const noexcept override { return active_ == 0 && paths_.silent(); }

  void add_counters(RenderCounters& counters) const noexcept override {
    counters.voices += static_cast<std::uint64_t>(active_);
    counters.sources_dropped += dropped_;
    counters.cues_dropped += unusable_;
  }

 private:
  ClothPatch* find(std::uint64_t id) noexcept {
    const auto found = std::ranges::find_if(patches_, [&](const ClothPatch& p) { return p.active() && p.id() == id; });
    return found == patches_.end() ? nullptr : &*found;
  }

  void render(ClothPatch& patch, const SceneSpan& scene, SampleTime quantum_start, const BusSamples& out) noexcept {
    patch.make(quantum_start);
    if (!patch.active()) {
      --active_;
      return;
    }
    if (out.emitters) give_off(patch, quantum_start, *out.emitters);
    if (patch.channel() == kEveryChannel) {
      paths_.spread(patch.past(), patch.bus(), patch.emitter(quantum_start), patch.emitter(quantum_start + kQuantum), scene,
                    quantum_start, out);
      return;
    }
    // Where there is one channel only it has the power of both.
    const int channel = std::min<int>(patch.channel(), channels_ - 1);
    const float gain = channels_ == 1 ? std::sqrt(0.5F) : 1.0F;
    std::array<float, kQuantum> sound;
    patch.past().read(quantum_start - kPathLag, sound);
    float* samples = out.add_to(patch.bus(), channel);
    for (std::size_t n = 0; n < sound.size(); ++n) samples[n] += gain * sound[n];
  }

  static void give_off(const ClothPatch& patch, SampleTime quantum_start, EmitterSounds& emitters) noexcept {
    float* samples = emitters.add_to(patch.id(), patch.bus(), patch.emitter(quantum_start));
    if (!samples) return;
    std::array<float, kQuantum> sound;
    patch.past().read(quantum_start - kPathLag, sound);
    for (std::size_t n = 0; n < sound.size(); ++n) samples[n] += sound[n];
  }

  int channels_;
  std::vector<ClothPatch> patches_;
  SourcePaths paths_;
  int active_ = 0;
  std::uint64_t dropped_ = 0;
  std::uint64_t unusable_ = 0;
};

}  // namespace

spatial::Emitter between(const spatial::Emitter& a, const spatial::Emitter& b, double share) noexcept {
  spatial::Emitter out = b;
  if (share >= 1) return out;
  out.position_m = a.position_m + share * (b.position_m - a.position_m);
  out.normal = spatial::normalized(a.normal + share * (b.normal - a.normal), b.normal);
  out.cosine_floor = std::lerp(a.cosine_floor, b.cosine_floor, share);
  return out;
}

std::vector<std::vector<float>> heard_filters(const spatial::Emitter& emitter, const spatial::Listener& listener,
                                              std::span<const spatial::Plane> planes, const PlanOptions& options) {
  const spatial::Hrtf* hrtf = options.layout == spatial::Layout::kBinaural ? options.hrtf.get() : nullptr;
  const auto receivers = spatial::receivers(listener, options.layout);
  const std::size_t taps = hrtf ? static_cast<std::size_t>(hrtf->taps()) : 1;
  const auto latest = static_cast<std::size_t>(kLatestImage_s * options.rate_hz);
  std::vector<std::vector<float>> filters(2, std::vector<float>(latest + taps));
  std::vector<float> ear(taps, 1.0F);
  std::array<spatial::Path, spatial::kMaxPaths> paths;
  for (std::size_t c = 0; c < filters.size(); ++c) {
    const auto& receiver = options.layout == spatial::Layout::kMono ? receivers[0] : receivers[c];
    const std::size_t count = spatial::paths(emitter, receiver, listener.position_m, planes, paths);
    for (const spatial::Path& path : std::span(paths).first(count)) {
      double delay_s = path.delay_s;
      if (hrtf) {
        const auto place = hrtf->place(spatial::head_coordinates(listener, path.arrival_m));
        hrtf->filter(place, static_cast<int>(c), ear);
        delay_s += hrtf->delay_s(place, static_cast<int>(c));
      }
      const double delay = delay_s * options.rate_hz;
      if (path.gain == 0 || delay > static_cast<double>(latest)) continue;
      const auto at = static_cast<std::size_t>(std::max(0.0, std::round(delay)));
      for (std::size_t k = 0; k < taps; ++k) filters[c][std::min(at, latest) + k] += static_cast<float>(path.gain) * ear[k];
    }
  }
  return filters;
}

std::unique_ptr<RenderModel> make_cloth_patches(const RenderOptions& options) {
  return std::make_unique<ClothPatches>(options);
}

}  // namespace rustle::synthesis
