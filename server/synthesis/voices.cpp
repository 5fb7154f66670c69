#include "server/synthesis/voices.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

namespace rustle::synthesis {
namespace {

constexpr double kMaxSlide = 8;  ///< change of delay in a quantum that is heard as motion, in samples
constexpr double kMaxDelay_s = 2.0;
constexpr double kGlance_s = 0.010;  ///< how far ahead a voice's loudness is judged

/// One path to one channel at one time.
struct Tap {
  float gain = 0;
  double delay = 0;  ///< samples
};

struct Voice {
  bool active = false;
  bool fading = false;
  std::uint64_t event = 0;
  Bus bus = 0;
  const float* unit = nullptr;
  int unit_samples = 0;
  SampleTime onset = 0;
  spatial::Emitter emitter;
  float gain = 0;
  float goal = 0;     ///< that `gain` goes to
  float step = 0;     ///< per quantum
  double latest = 0;  ///< largest delay, samples
  std::array<std::array<Tap, spatial::kMaxPaths>, spatial::kMaxChannels> taps;
};

/// Adds unit positions first, first + step, ... (kQuantum of them) under a gain that goes straight from gain0 to gain1.
/// \pre |step| ≤ 1 + kMaxSlide / kQuantum
void add_run(const float* unit, int unit_samples, double first, double step, float gain0, float gain1, float* out) noexcept {
  const double last = first + (kQuantum - 1) * step;
  const double lowest = std::floor(std::min(first, last)) - 1;
  const double highest = std::floor(std::max(first, last)) + 2;
  if (highest < 0 || lowest >= unit_samples) return;
  const int low = static_cast<int>(lowest);
  const int count = static_cast<int>(highest - lowest) + 2;  // one more: rounding may carry the last position over
  std::array<float, kQuantum + 32> padded;
  const float* x = unit + low;
  if (low < 0 || low + count > unit_samples) {
    const int from = std::max(low, 0);
    const int to = std::min(low + count, unit_samples);
    padded.fill(0);
    if (to > from)
      std::memcpy(padded.data() + (from - low), unit + from, static_cast<std::size_t>(to - from) * sizeof(float));
    x = padded.data();
  }
  const float slope = (gain1 - gain0) / kQuantum;
  const double offset = first - lowest;
  if (step == 1.0) {
    const int whole = static_cast<int>(offset);
    const auto f = static_cast<float>(offset - whole);
    const float a = -f * (f - 1) * (f - 2) / 6, b = (f + 1) * (f - 1) * (f - 2) / 2;
    const float c = -(f + 1) * f * (f - 2) / 2, d = (f + 1) * f * (f - 1) / 6;
    const float* y = x + whole - 1;
    for (int n = 0; n < kQuantum; ++n) {
      out[n] += (gain0 + slope * static_cast<float>(n)) * (a * y[n] + b * y[n + 1] + c * y[n + 2] + d * y[n + 3]);
    }
    return;
  }
  const auto begin = static_cast<float>(offset);
  const auto pace = static_cast<float>(step);
  for (int n = 0; n < kQuantum; ++n) {
    const float position = begin + static_cast<float>(n) * pace;
    const int whole = static_cast<int>(position);
    const float f = position - static_cast<float>(whole);
    const float* y = x + whole - 1;
    const float a = -f * (f - 1) * (f - 2) / 6, b = (f + 1) * (f - 1) * (f - 2) / 2;
    const float c = -(f + 1) * f * (f - 2) / 2, d = (f + 1) * f * (f - 1) / 6;
    out[n] += (gain0 + slope * static_cast<float>(n)) * (a * y[0] + b * y[1] + c * y[2] + d * y[3]);
  }
}

/// The same along a path: from delay0 to delay1 within the quantum whose first sample is `age` after the onset.
void add_path(const Voice& voice, double age, double delay0, double delay1, float gain0, float gain1, float* out) noexcept {
  if (gain0 == 0 && gain1 == 0) return;
  if (gain0 == 0) delay0 = delay1;
  if (gain1 == 0) delay1 = delay0;
  const double slide = delay1 - delay0;
  if (std::abs(slide) <= kMaxSlide) {
    add_run(voice.unit, voice.unit_samples, age - delay0, 1.0 - slide / kQuantum, gain0, gain1, out);
  } else {
    add_run(voice.unit, voice.unit_samples, age - delay0, 1.0, gain0, 0, out);
    add_run(voice.unit, voice.unit_samples, age - delay1, 1.0, 0, gain1, out);
  }
}

bool finite(const CrumpleCue& cue) noexcept {
  const spatial::Vec3& p = cue.emitter.position_m;
  const spatial::Vec3& n = cue.emitter.normal;
  return std::isfinite(cue.gain) && std::isfinite(p.x + p.y + p.z) && std::isfinite(n.x + n.y + n.z) &&
         std::isfinite(cue.emitter.cosine_floor);
}

class Voices final : public RenderModel {
 public:
  explicit Voices(const RenderOptions& options)
      : channels_(options.channels()),
        limit_(options.max_voices),
        rate_hz_(options.rate_hz),
        ramp_quanta_(std::max(1, static_cast<int>(std::ceil(kVoiceRamp_s * options.rate_hz / kQuantum)))),
        voices_(static_cast<std::size_t>(options.max_voices + kFadingVoices)),
        loudness_(voices_.size()) {}

  void apply(const Cue& cue, const SceneSpan& scene, SampleTime quantum_start) noexcept override {
    if (const auto* begun = std::get_if<CrumpleCue>(&cue)) {
      begin(*begun, scene, quantum_start);
    } else if (const auto* raise = std::get_if<CrumpleRaiseCue>(&cue)) {
      if (!std::isfinite(raise->factor)) {
        ++unusable_;
        return;
      }
      for (Voice& voice : voices_) {
        const bool meant = voice.active && !voice.fading && voice.event == raise->event && voice.bus == raise->bus;
        if (meant) ramp_to(voice, voice.goal * raise->factor);
      }
    }
  }

  void render(const SceneSpan& scene, SampleTime quantum_start, const BusSamples& out) noexcept override {
    judged_ = false;
    if (sounding_ + fading_ == 0) return;
    for (Voice& voice : voices_) {
      if (voice.active) render_voice(voice, scene, quantum_start, out);
    }
  }

  bool silent() const noexcept override { return sounding_ + fading_ == 0; }

  void add_counters(RenderCounters& counters) const noexcept override {
    counters.voices += static_cast<std::uint64_t>(sounding_ + fading_);
    counters.voices_stolen += stolen_;
    counters.voices_dropped += dropped_;
    counters.cues_dropped += unusable_;
  }

 private:
  void begin(const CrumpleCue& cue, const SceneSpan& scene, SampleTime quantum_start) noexcept {
    if (!finite(cue) || !cue.unit || cue.unit_samples == 0) {
      ++unusable_;
      return;
    }
    if (sounding_ >= limit_) steal(quantum_start);
    const auto free = std::find_if(voices_.begin(), voices_.end(), [](const Voice& voice) { return !voice.active; });
    if (free == voices_.end() || sounding_ >= limit_) {
      ++dropped_;
      return;
    }
    Voice& voice = *free;
    voice.active = true;
    voice.fading = false;
    voice.event = cue.event;
    voice.bus = cue.bus;
    voice.unit = cue.unit;
    voice.unit_samples = static_cast<int>(std::min<std::uint32_t>(cue.unit_samples, 1U << 30));
    voice.onset = cue.onset;
    voice.emitter = cue.emitter;
    voice.gain = voice.goal = cue.gain;
    voice.step = 0;
    place(voice, scene.before, voice.taps);
    ++sounding_;
    if (judged_) loudness_[static_cast<std::size_t>(free - voices_.begin())] = loudness(voice, quantum_start);
  }

  void ramp_to(Voice& voice, float goal) const noexcept {
    voice.goal = goal;
    voice.step = (goal - voice.gain) / static_cast<float>(ramp_quanta_);
  }

  using Taps = std::array<std::array<Tap, spatial::kMaxPaths>, spatial::kMaxChannels>;

  void place(Voice& voice, const AcousticScene& scene, Taps& taps) const noexcept {
    std::array<spatial::Path, spatial::kMaxPaths> ways;
    const double limit = kMaxDelay_s * rate_hz_;
    voice.latest = 0;
    for (std::size_t c = 0; c < static_cast<std::size_t>(channels_); ++c) {
      const std::size_t count =
          spatial::paths(voice.emitter, scene.receivers[c], scene.listener.position_m, scene.used_planes(), ways);
      for (std::size_t p = 0; p < count; ++p) {
        const double delay = std::clamp(ways[p].delay_s * rate_hz_, -limit, limit);
        taps[c][p] = {static_cast<float>(ways[p].gain), delay};
        voice.latest = std::max(voice.latest, delay);
      }
      for (std::size_t p = count; p < taps[c].size(); ++p) taps[c][p] = {};
    }
  }

  void render_voice(Voice& voice, const SceneSpan& scene, SampleTime quantum_start, const BusSamples& out) noexcept {
    const auto age = static_cast<double>(quantum_start - voice.onset);
    if (age - voice.latest > voice.unit_samples + 4) return end(voice);
    const float gain0 = voice.gain;
    float gain1 = gain0 + voice.step;
    if (voice.step != 0 && std::abs(voice.goal - gain1) < 0.5F * std::abs(voice.step)) {
      gain1 = voice.goal;
      voice.step = 0;
    }
    Taps moved;
    if (scene.moves) place(voice, scene.after, moved);
    const Taps& next = scene.moves ? moved : voice.taps;
    const std::size_t paths = 1 + static_cast<std::size_t>(scene.after.plane_count);
    for (int c = 0; c < channels_; ++c) {
      float* samples = out.add_to(voice.bus, c);
      for (std::size_t p = 0; p < paths; ++p) {
        const Tap& from = voice.taps[static_cast<std::size_t>(c)][p];
        const Tap& to = next[static_cast<std::size_t>(c)][p];
        add_path(voice, age, from.delay, to.delay, gain0 * from.gain, gain1 * to.gain, samples);
      }
    }
    if (scene.moves) voice.taps = moved;
    voice.gain = gain1;
    if (voice.fading && voice.step == 0) end(voice);
  }

  void end(Voice& voice) noexcept {
    --(voice.fading ? fading_ : sounding_);
    voice.active = false;
  }

  double loudness(const Voice& voice, SampleTime quantum_start) const noexcept {
    const int from = static_cast<int>(std::clamp<SampleTime>(quantum_start - voice.onset, 0, voice.unit_samples));
    const int to = std::min(voice.unit_samples, from + static_cast<int>(kGlance_s * rate_hz_));
    double energy = 0;
    for (int n = from; n < to; n += 4) energy += static_cast<double>(voice.unit[n]) * voice.unit[n];
    double heard = 0;
    for (const auto& channel : voice.taps) {
      for (const Tap& tap : channel) heard = std::max(heard, std::abs(static_cast<double>(tap.gain)));
    }
    return energy * heard * heard * voice.goal * voice.goal;
  }

  void steal(SampleTime quantum_start) noexcept {
    if (!judged_) {
      for (std::size_t i = 0; i < voices_.size(); ++i)
        loudness_[i] = voices_[i].active ? loudness(voices_[i], quantum_start) : 0;
      judged_ = true;
    }
    std::size_t quietest = voices_.size();
    for (std::size_t i = 0; i < voices_.size(); ++i) {
      if (!voices_[i].active || voices_[i].fading) continue;
      if (quietest == voices_.size() || loudness_[i] < loudness_[quietest]) quietest = i;
    }
    if (quietest == voices_.size() || fading_ >= kFadingVoices) return;
    Voice& voice = voices_[quietest];
    voice.fading = true;
    ramp_to(voice, 0);
    --sounding_;
    ++fading_;
    ++stolen_;
  }

  int channels_;
  int limit_;
  double rate_hz_;
  int ramp_quanta_;
  std::vector<Voice> voices_;
  std::vector<double> loudness_;  ///< of each voice, valid within a quantum once judged_
  bool judged_ = false;
  int sounding_ = 0;
  int fading_ = 0;
  std::uint64_t stolen_ = 0;
  std::uint64_t dropped_ = 0;
  std::uint64_t unusable_ = 0;
};

}  // namespace

std::unique_ptr<RenderModel> make_voices(const RenderOptions& options) {
  return std::make_unique<Voices>(options);
}

}  // namespace rustle::synthesis
