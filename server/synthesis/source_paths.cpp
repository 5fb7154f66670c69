#include "server/synthesis/source_paths.h"

#include <algorithm>
#include <cmath>

namespace rustle::synthesis {
namespace {

constexpr Position kMostSlide = kQuantum / 8 * kWholeSample;  ///< change of delay in a quantum that is heard as motion
constexpr float kInaudible = 1e-6F;                           ///< paths with less gain are left out
constexpr int kReach = 2;                                     ///< samples on either side that interpolation reaches to

void add_run(const SoundPast& sound, SampleTime start, Position delay, std::int32_t slide, float gain0, float gain1,
             float* out) noexcept {
  std::array<float, kQuantum + kQuantum / 8 + 2 * kReach + 2> window;
  const Position first = (start - kPathLag) * kWholeSample - delay;
  const SampleTime low = (std::min(first, first + (kQuantum - 1) * static_cast<Position>(slide)) >> 32) - kReach;
  sound.read(low, window);
  add_moving({window.data(), first - low * kWholeSample, slide, gain0, (gain1 - gain0) / kQuantum}, out);
}

}  // namespace

SourcePaths::SourcePaths(const RenderOptions& options)
    : channels_(static_cast<std::size_t>(options.channels())), rate_hz_(options.rate_hz) {
  if (options.layout == spatial::Layout::kBinaural && options.hrtf) ears_.emplace(options.hrtf, options.buses());
}

SampleTime SourcePaths::past_samples(std::uint32_t rate_hz) noexcept {
  return static_cast<SampleTime>(kLongestPath_s * rate_hz) + kPathLag + 3 * kQuantum;
}

void SourcePaths::spread(const SoundPast& sound, Bus bus, const spatial::Emitter& emitter_from,
                         const spatial::Emitter& emitter_to, const SceneSpan& scene, SampleTime quantum_start,
                         const BusSamples& out) noexcept {
  // From one tap to the next within the quantum.
  const auto add_path = [&](const Tap& from, const Tap& to, float* samples) {
    const Position slide = from.delay - to.delay;
    if (std::abs(slide) <= kMostSlide) {
      add_run(sound, quantum_start, from.delay, static_cast<std::int32_t>(slide / kQuantum), from.gain, to.gain, samples);
    } else {
      add_run(sound, quantum_start, from.delay, 0, from.gain, 0, samples);
      add_run(sound, quantum_start, to.delay, 0, 0, to.gain, samples);
    }
  };
  Taps from, to;
  find_taps(sound.reach(), emitter_from, scene.before, from);
  find_taps(sound.reach(), emitter_to, scene.moves ? scene.after : scene.before, to);
  for (std::size_t c = 0; c < channels_; ++c) {
    for (std::size_t p = 0; p < std::max(from.count, to.count); ++p) {
      Tap a = p < from.count ? from.at[c][p] : Tap{}, b = p < to.count ? to.at[c][p] : Tap{};
      if (std::max(std::abs(a.gain), std::abs(b.gain)) < kInaudible) continue;
      if (a.gain == 0) a.delay = b.delay;
      if (b.gain == 0) b.delay = a.delay;
      if (!ears_) {
        add_path(a, b, out.add_to(bus, static_cast<int>(c)));
        continue;
      }
      EarFilters::Quantum heard{};
      add_path(a, b, heard.data());
      ears_->add(bus, static_cast<int>(c), from.places[p], to.places[p], heard);
    }
  }
}

void SourcePaths::finish(const BusSamples& out) noexcept {
  if (ears_) ears_->render(out);
}

void SourcePaths::find_taps(SampleTime reach, const spatial::Emitter& emitter, const AcousticScene& scene,
                            Taps& taps) const noexcept {
  std::array<spatial::Path, spatial::kMaxPaths> paths;
  const auto planes = scene.used_planes();
  const spatial::Vec3& centre_m = scene.listener.position_m;
  if (ears_) {
    taps.count = spatial::paths(emitter, {centre_m}, centre_m, planes, paths);
    for (std::size_t p = 0; p < taps.count; ++p)
      taps.places[p] = ears_->hrtf().place(spatial::head_coordinates(scene.listener, paths[p].arrival_m));
  }
  for (std::size_t c = 0; c < channels_; ++c) {
    if (!ears_) taps.count = spatial::paths(emitter, scene.receivers[c], centre_m, planes, paths);
    for (std::size_t p = 0; p < taps.count; ++p) {
      const double ear_s = ears_ ? ears_->hrtf().delay_s(taps.places[p], static_cast<int>(c)) : 0;
      const double most = static_cast<double>(reach - 2 * kQuantum);
      const double delay = std::clamp((paths[p].delay_s + ear_s) * rate_hz_, static_cast<double>(kReach + 1 - kPathLag),
                                      std::min(kLongestPath_s * rate_hz_, most));
      taps.at[c][p] = {static_cast<float>(paths[p].gain),
                       static_cast<Position>(std::llround(delay * static_cast<double>(kWholeSample)))};
    }
  }
}

}  // namespace rustle::synthesis
