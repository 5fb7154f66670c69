#include "server/synthesis/voices.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>

#include "server/sheet/simd.h"
#include "server/synthesis/ear_filters.h"
#include "server/synthesis/emitter_motion.h"
#include "server/synthesis/emitter_sounds.h"
#include "server/synthesis/interpolation.h"
#include "sound_db/dsp/random.h"

namespace rustle::synthesis {
namespace {

constexpr SampleTime kReadBeside = 1;             ///< samples that a moving reading touches beside those it needs
constexpr Position kMaxSlide = 8 * kWholeSample;  ///< change of delay in a quantum that is heard as motion
constexpr double kMaxDelay_s = 2.0;
constexpr double kGlance_s = 0.010;  ///< how far ahead a voice's loudness is judged
constexpr float kInaudible = 1e-5F;  ///< paths with less gain are left out
constexpr SampleTime kMostSamples = SampleTime{1} << 30;
constexpr std::size_t kTapsInPart = 64;  ///< whose samples stay in the nearest cache
constexpr SampleTime kNever = std::numeric_limits<SampleTime>::max();
constexpr int kReach = 2;                ///< samples on either side that interpolation reaches to
constexpr int kReadings = kQuantum + 3;  ///< samples that a quantum is made of
constexpr std::size_t kPaths = spatial::kMaxPaths;

/// One path to one channel at one time.
struct Tap {
  float gain = 0;
  Position delay = 0;
};
using Taps = std::array<std::array<Tap, kPaths>, spatial::kMaxChannels>;
/// By path: where it comes from, to ears.
using Arrivals = std::array<spatial::Hrtf::Place, kPaths>;

/// A tap that stays as it is: in the quantum from quantum_start on it reads from unit[quantum_start - onset + offset].
struct SettledTap {
  std::array<float, 4> weights_gain;
  std::int32_t offset;
  bool whole;  ///< the delay is a whole number of samples: weights_gain is (0, gain, 0, 0)
};

struct Voice {
  bool fading = false;
  Bus bus = 0;
  int unit_samples = 0;
  const float* unit = nullptr;
  SampleTime onset = 0;
  SampleTime last_age = 0;  ///< the unit has passed after it
  float gain = 0;
  float goal = 0;  ///< that `gain` goes to
  float step = 0;  ///< per quantum
};

/// A voice at rest.
struct SettledVoice {
  bool valid = false;   ///< these are the taps of the voice's place and gain
  bool listed = false;  ///< its taps are in the lists
  std::uint32_t count = 0;
  std::array<SettledTap, spatial::kMaxChannels * kPaths> taps;
  std::array<std::uint8_t, spatial::kMaxChannels * kPaths> channel;
  std::array<std::uint8_t, spatial::kMaxChannels * kPaths> path;
  std::array<std::uint32_t, spatial::kMaxChannels * kPaths> listed_at;
};

/// What a voice is asked for only when something moves or changes.
struct VoicePlace {
  std::uint64_t event = 0;
  std::uint16_t resonator = 0;
  spatial::Emitter emitter;
  Taps taps;
  Arrivals arrivals;
};

/// Taps of one channel that read within their units and go on like that from quantum to quantum.
template <class T>
class TapList {
 public:
  explicit TapList(std::size_t most) {
    taps_.reserve(most);
    buses_.reserve(most);
    places_.reserve(most);
  }

  /// Keeps `place` told where in the list the tap is, until it is removed.
  void add(const T& tap, Bus bus, std::uint32_t& place) noexcept {
    place = static_cast<std::uint32_t>(taps_.size());
    taps_.push_back(tap);
    buses_.push_back(bus);
    places_.push_back(&place);
  }

  /// The last one takes its place.
  void remove(std::uint32_t at) noexcept {
    *places_.back() = at;
    taps_[at] = taps_.back();
    buses_[at] = buses_.back();
    places_[at] = places_.back();
    taps_.pop_back();
    buses_.pop_back();
    places_.pop_back();
  }

  std::size_t size() const noexcept { return taps_.size(); }

  /// A run of neighbours in one bus, from one place in the list to before `end`; empty where there is none in that bus.
  struct Run {
    std::size_t from, to;
  };
  Run run_in(Bus bus, std::size_t from, std::size_t end) const noexcept {
    constexpr std::size_t kAtOnce = 32;
    std::size_t to = from;
    for (int others = 0; to + kAtOnce <= end && others == 0; to += others == 0 ? kAtOnce : 0) {
      for (std::size_t k = 0; k < kAtOnce; ++k) others |= buses_[to + k] ^ bus;
    }
    while (to < end && buses_[to] == bus) ++to;
    return {from, to};
  }
  Bus bus(std::size_t at) const noexcept { return buses_[at]; }
  std::span<T> taps(Run run) noexcept { return std::span(taps_).subspan(run.from, run.to - run.from); }

 private:
  std::vector<T> taps_;
  std::vector<Bus> buses_;
  std::vector<std::uint32_t*> places_;
};

/// Room for what readings at the ends of a unit need.
struct Window {
  std::array<float, kQuantum + 32> samples;

  /// unit[low .. low + count), zero outside the unit. \pre count ≤ the window
  const float* of(const Voice& voice, SampleTime low, SampleTime count) noexcept {
    samples.fill(0);
    const SampleTime from = std::max<SampleTime>(low, 0);
    const SampleTime to = std::min<SampleTime>(low + count, voice.unit_samples);
    if (to > from) std::copy(voice.unit + from, voice.unit + to, samples.begin() + (from - low));
    return samples.data();
  }
};

/// Adds the readings from `first` on under a gain that goes straight from gain0 to gain1 within the quantum.
void add_run(const Voice& voice, Position first, std::int32_t slide, float gain0, float gain1, float* out) noexcept {
  const Position last = first + (kQuantum - 1) * (kWholeSample + slide);
  const SampleTime low = (std::min(first, last) >> 32) - 1 - kReadBeside;
  const SampleTime high = (std::max(first, last) >> 32) + 2 + kReadBeside;
  if (high < 0 || low >= voice.unit_samples) return;
  Window window;
  MovingTap tap{voice.unit, first, slide, gain0, (gain1 - gain0) / kQuantum};
  if (low < 0 || high >= voice.unit_samples) {
    tap.x = window.of(voice, low, high - low + 1);
    tap.first -= low * kWholeSample;
  }
  add_moving(tap, out);
}

/// Adds one path: from one tap to the next within the quantum whose first sample is `age` after the onset.
void add_path(const Voice& voice, SampleTime age, Tap from, Tap to, float* out) noexcept {
  if (from.gain == 0) from.delay = to.delay;
  if (to.gain == 0) to.delay = from.delay;
  const Position start = age * kWholeSample;
  const Position slide = from.delay - to.delay;
  if (std::abs(slide) <= kMaxSlide) {
    add_run(voice, start - from.delay, static_cast<std::int32_t>(slide / kQuantum), from.gain, to.gain, out);
  } else {
    add_run(voice, start - from.delay, 0, from.gain, 0, out);
    add_run(voice, start - to.delay, 0, 0, to.gain, out);
  }
}

/// Σ x², in an order of its own for any instruction set.
RUSTLE_SIMD float energy(const float* x, int count) noexcept {
  std::array<float, 16> sums{};
  int n = 0;
  for (; n + 16 <= count; n += 16) {
    for (int k = 0; k < 16; ++k) sums[static_cast<std::size_t>(k)] += x[n + k] * x[n + k];
  }
  for (int k = 0; n < count; ++n, ++k) sums[static_cast<std::size_t>(k)] += x[n] * x[n];
  float sum = 0;
  for (const float s : sums) sum += s;
  return sum;
}

bool finite(const spatial::Vec3& v) noexcept {
  return std::isfinite(v.x + v.y + v.z);
}

bool finite(const CrumpleCue& cue) noexcept {
  return std::isfinite(cue.gain) && finite(cue.emitter.position_m) && finite(cue.emitter.normal) &&
         std::isfinite(cue.emitter.cosine_floor);
}

/// Slots, the lowest free one first.
class Slots {
 public:
  explicit Slots(std::size_t count) : words_((count + 63) / 64), count_(count) {}

  /// The lowest free slot, or the number of slots.
  std::size_t take() noexcept {
    for (std::size_t w = 0; w < words_.size(); ++w) {
      if (~words_[w] == 0) continue;
      const std::size_t slot = 64 * w + static_cast<std::size_t>(std::countr_one(words_[w]));
      if (slot >= count_) break;
      words_[w] |= std::uint64_t{1} << (slot % 64);
      return slot;
    }
    return count_;
  }
  void take(std::size_t slot) noexcept { words_[slot / 64] |= std::uint64_t{1} << (slot % 64); }
  void give_back(std::size_t slot) noexcept { words_[slot / 64] &= ~(std::uint64_t{1} << (slot % 64)); }

  /// Calls visit(slot) for every taken slot in order; the visited one may be given back.
  template <class Visit>
  void each(Visit&& visit) const noexcept {
    for (std::size_t w = 0; w < words_.size(); ++w) {
      for (std::uint64_t left = words_[w]; left != 0; left &= left - 1)
        visit(64 * w + static_cast<std::size_t>(std::countr_zero(left)));
    }
  }

 private:
  std::vector<std::uint64_t> words_;
  std::size_t count_;
};

class Voices final : public RenderModel {
 public:
  explicit Voices(const RenderOptions& options)
      : channels_(static_cast<std::size_t>(options.channels())),
        most_(options.max_voices),
        limit_(most_),
        rate_hz_(options.rate_hz),
        ramp_quanta_(std::max(1, static_cast<int>(std::ceil(kVoiceRamp_s * options.rate_hz / kQuantum)))),
        slots_(static_cast<std::size_t>(options.max_voices + kFadingVoices)),
        voices_(static_cast<std::size_t>(options.max_voices + kFadingVoices)),
        places_(voices_.size()),
        unlisted_(voices_.size()),
        settled_(voices_.size()),
        inside_to_(voices_.size(), kNever),
        whole_{TapList<WholeTap>(voices_.size() * kPaths), TapList<WholeTap>(voices_.size() * kPaths)},
        still_{TapList<StillTap>(voices_.size() * kPaths), TapList<StillTap>(voices_.size() * kPaths)},
        loudness_(voices_.size()),
        motions_(options.buses()) {
    if (options.layout == spatial::Layout::kBinaural && options.hrtf) ears_.emplace(options.hrtf, options.buses());
  }

  void apply(const Cue& cue, const SceneSpan& scene, SampleTime quantum_start) noexcept override {
    if (const auto* begun = std::get_if<CrumpleCue>(&cue)) {
      begin(*begun, scene, quantum_start);
    } else if (const auto* raise = std::get_if<CrumpleRaiseCue>(&cue)) {
      if (!std::isfinite(raise->factor)) {
        ++unusable_;
        return;
      }
      slots_.each([&](std::size_t slot) {
        const Voice& voice = voices_[slot];
        const bool meant = !voice.fading && voice.bus == raise->bus && places_[slot].event == raise->event;
        if (meant) ramp_to(slot, voice.goal * raise->factor);
      });
    } else if (const auto* motion = std::get_if<EmitterMotionCue>(&cue)) {
      if (finite(motion->from_m) && finite(motion->to_m) && finite(motion->turn_rad)) {
        motions_.apply(*motion, quantum_start);
      } else {
        ++unusable_;
      }
    } else if (const auto* limit = std::get_if<VoiceLimitCue>(&cue)) {
      limit_ = std::min(limit->most, most_);
    }
  }

  void render(const SceneSpan& scene, SampleTime quantum_start, const BusSamples& out) noexcept override {
    while (sounding_ > limit_ && fading_ < kFadingVoices) steal(quantum_start);
    judged_ = false;
    motions_.advance(quantum_start);
    if (out.emitters) give_off(quantum_start, *out.emitters);
    if (sounding_ + fading_ > 0) render_voices(scene, quantum_start, out);
    if (ears_) ears_->render(out);
  }

  bool silent() const noexcept override { return sounding_ + fading_ == 0 && (!ears_ || ears_->silent()); }

  void add_counters(RenderCounters& counters) const noexcept override {
    counters.voices += static_cast<std::uint64_t>(sounding_ + fading_);
    counters.voices_stolen += stolen_;
    counters.voices_dropped += dropped_;
    counters.cues_dropped += unusable_;
  }

 private:
  /// A voice's gain at the quantum's end.
  static float next_gain(const Voice& voice) noexcept {
    const float next = voice.gain + voice.step;
    return voice.step != 0 && std::abs(voice.goal - next) < 0.5F * std::abs(voice.step) ? voice.goal : next;
  }

  /// An event's resonator is an emitter; the slips of a friction source come from that.
  static std::uint64_t emitter_of(const Voice& voice, const VoicePlace& place) noexcept {
    if (kind_of(voice.bus) == SoundKind::kFriction) return place.event;
    return dsp::hash(dsp::hash(voice.bus, place.event), place.resonator);
  }

  /// Every voice by itself and where it is, before anything moves.
  void give_off(SampleTime quantum_start, EmitterSounds& emitters) const noexcept {
    slots_.each([&](std::size_t slot) {
      const Voice& voice = voices_[slot];
      const SampleTime age = quantum_start - voice.onset;
      const SampleTime from = std::clamp<SampleTime>(-age, 0, kQuantum);
      const SampleTime to = std::clamp<SampleTime>(voice.unit_samples - age, 0, kQuantum);
      if (from >= to) return;
      float* samples = emitters.add_to(emitter_of(voice, places_[slot]), voice.bus, places_[slot].emitter);
      if (!samples) return;
      const float slope = (next_gain(voice) - voice.gain) / kQuantum;
      for (SampleTime n = from; n < to; ++n)
        samples[n] += (voice.gain + slope * static_cast<float>(n)) * voice.unit[age + n];
    });
  }

  void render_voices(const SceneSpan& scene, SampleTime quantum_start, const BusSamples& out) noexcept {
    if (scene.moves || motions_.any()) {
      slots_.each([&](std::size_t slot) { unlist(slot); });
    } else if (quantum_start > first_to_leave_) {
      first_to_leave_ = kNever;
      slots_.each([&](std::size_t slot) {
        if (quantum_start > inside_to_[slot]) unlist(slot);
        first_to_leave_ = std::min(first_to_leave_, inside_to_[slot]);
      });
    }
    unlisted_.each([&](std::size_t slot) { render_unlisted(slot, scene, quantum_start, out); });
    // Taps of one voice stand at like places in all lists: a part of each at a time, its samples come from memory once.
    std::size_t most = 0;
    for (std::size_t c = 0; c < channels_; ++c) most = std::max({most, whole_[c].size(), still_[c].size()});
    const std::size_t parts = channels_ == 1 ? 1 : (most + kTapsInPart - 1) / kTapsInPart;
    for (std::size_t part = 0; part < parts; ++part) {
      for (std::size_t c = 0; c < channels_; ++c) play_listed(c, part, parts, out);
    }
  }

  /// One of so many parts of a channel's lists, bus after bus.
  void play_listed(std::size_t channel, std::size_t part, std::size_t parts, const BusSamples& out) noexcept {
    TapList<WholeTap>& whole = whole_[channel];
    TapList<StillTap>& still = still_[channel];
    std::size_t w = whole.size() * part / parts, s = still.size() * part / parts;
    const std::size_t whole_end = whole.size() * (part + 1) / parts, still_end = still.size() * (part + 1) / parts;
    while (w < whole_end || s < still_end) {
      const Bus bus = s < still_end ? still.bus(s) : whole.bus(w);
      const auto whole_run = whole.run_in(bus, w, whole_end);
      const auto still_run = still.run_in(bus, s, still_end);
      add_taps(whole.taps(whole_run), still.taps(still_run), out.add_to(bus, static_cast<int>(channel)));
      w = whole_run.to;
      s = still_run.to;
    }
  }

  void begin(const CrumpleCue& cue, const SceneSpan& scene, SampleTime quantum_start) noexcept {
    if (!finite(cue) || !cue.unit || cue.unit_samples == 0) {
      ++unusable_;
      return;
    }
    if (sounding_ >= limit_) steal(quantum_start);
    const std::size_t slot = sounding_ < limit_ ? slots_.take() : voices_.size();
    if (slot == voices_.size()) {
      ++dropped_;
      return;
    }
    Voice& voice = voices_[slot];
    voice = {};
    voice.bus = cue.bus;
    voice.unit = cue.unit;
    voice.unit_samples = static_cast<int>(std::min<std::uint32_t>(cue.unit_samples, kMostSamples));
    voice.onset = cue.onset;
    voice.gain = voice.goal = cue.gain;
    unlisted_.take(slot);
    settled_[slot].valid = settled_[slot].listed = false;
    places_[slot].event = cue.event;
    places_[slot].resonator = cue.resonator;
    places_[slot].emitter = cue.emitter;
    voice.last_age = voice.unit_samples + place(cue.emitter, scene.before, places_[slot].taps, places_[slot].arrivals);
    ++sounding_;
    if (judged_) loudness_[slot] = loudness(slot, quantum_start);
  }

  void ramp_to(std::size_t slot, float goal) noexcept {
    unsettle(slot);
    Voice& voice = voices_[slot];
    voice.goal = goal;
    voice.step = (goal - voice.gain) / static_cast<float>(ramp_quanta_);
  }

  /// The taps of an emitter in a scene; for ears with where they come from. Returns how much later than the unit the last of
  /// them is over, in samples.
  SampleTime place(const spatial::Emitter& emitter, const AcousticScene& scene, Taps& taps, Arrivals& arrivals) noexcept {
    const double limit = kMaxDelay_s * rate_hz_;
    Position latest = 0;
    for (std::size_t c = 0; c < channels_; ++c) {
      const std::size_t count =
          spatial::paths(emitter, scene.receivers[c], scene.listener.position_m, scene.used_planes(), ways_);
      most_paths_ = std::max(most_paths_, count);
      for (std::size_t p = 0; p < count; ++p) {
        double delay_s = ways_[p].delay_s;
        if (ears_) {
          if (c == 0) arrivals[p] = ears_->hrtf().place(spatial::head_coordinates(scene.listener, ways_[p].arrival_m));
          delay_s += ears_->hrtf().delay_s(arrivals[p], static_cast<int>(c));
        }
        const double delay = std::clamp(delay_s * rate_hz_, -limit, limit);
        taps[c][p] = {static_cast<float>(ways_[p].gain),
                      static_cast<Position>(std::nearbyint(delay * static_cast<double>(kWholeSample)))};
        latest = std::max(latest, taps[c][p].delay);
      }
      for (std::size_t p = count; p < most_paths_; ++p) taps[c][p] = {};
    }
    return (latest >> 32) + 1 + kReach;
  }

  void settle(std::size_t slot) noexcept {
    const Voice& voice = voices_[slot];
    SettledVoice& settled = settled_[slot];
    settled.valid = true;
    settled.count = 0;
    for (std::size_t c = 0; c < channels_; ++c) {
      for (std::size_t p = 0; p < most_paths_; ++p) {
        const Tap& tap = places_[slot].taps[c][p];
        const float gain = voice.gain * tap.gain;
        if (std::abs(gain) < kInaudible) continue;
        const Position fraction = -tap.delay & (kWholeSample - 1);
        settled.channel[settled.count] = static_cast<std::uint8_t>(c);
        settled.path[settled.count] = static_cast<std::uint8_t>(p);
        settled.taps[settled.count++] = {weights(fraction, gain), static_cast<std::int32_t>(-tap.delay >> 32) - 1,
                                         fraction == 0};
      }
    }
  }

  /// Calls add(samples) with where a path's sound goes: to its channel, or to be heard by an ear.
  template <class Add>
  void deliver(Bus bus, std::size_t channel, const spatial::Hrtf::Place& from, const spatial::Hrtf::Place& to,
               const BusSamples& out, Add&& add) noexcept {
    if (!ears_) return add(out.add_to(bus, static_cast<int>(channel)));
    EarFilters::Quantum sound{};
    add(sound.data());
    ears_->add(bus, static_cast<int>(channel), from, to, sound);
  }

  /// Lists a settled voice where from this quantum on all its taps read within the unit. Returns whether it does.
  bool list(std::size_t slot, SampleTime age) noexcept {
    if (ears_) return false;
    const Voice& voice = voices_[slot];
    SettledVoice& settled = settled_[slot];
    SampleTime to = voice.unit_samples - kReadings;
    for (const SettledTap& tap : std::span(settled.taps).first(settled.count)) {
      if (age + tap.offset < 0) return false;
      to = std::min<SampleTime>(to, voice.unit_samples - kReadings - tap.offset);
    }
    if (age > to) return false;
    for (std::size_t k = 0; k < settled.count; ++k) {
      const SettledTap& tap = settled.taps[k];
      const float* x = voice.unit + age + tap.offset;
      if (tap.whole) {
        whole_[settled.channel[k]].add({x + 1, tap.weights_gain[1]}, voice.bus, settled.listed_at[k]);
      } else {
        still_[settled.channel[k]].add({x, tap.weights_gain}, voice.bus, settled.listed_at[k]);
      }
    }
    settled.listed = true;
    unlisted_.give_back(slot);
    inside_to_[slot] = voice.onset + to;
    first_to_leave_ = std::min(first_to_leave_, inside_to_[slot]);
    return true;
  }

  void unlist(std::size_t slot) noexcept {
    SettledVoice& settled = settled_[slot];
    if (!settled.listed) return;
    settled.listed = false;
    unlisted_.take(slot);
    inside_to_[slot] = kNever;
    for (std::size_t k = 0; k < settled.count; ++k) {
      if (settled.taps[k].whole) {
        whole_[settled.channel[k]].remove(settled.listed_at[k]);
      } else {
        still_[settled.channel[k]].remove(settled.listed_at[k]);
      }
    }
  }

  void unsettle(std::size_t slot) noexcept {
    unlist(slot);
    settled_[slot].valid = false;
  }

  /// A voice that moves, changes its gain, or reads beyond an end of its unit.
  void render_unlisted(std::size_t slot, const SceneSpan& scene, SampleTime quantum_start, const BusSamples& out) noexcept {
    const Voice& voice = voices_[slot];
    const SampleTime age = std::max(quantum_start - voice.onset, -kMostSamples);
    if (age > voice.last_age) return end(slot);
    if (scene.moves || voice.step != 0 || motions_.moves(voice.bus)) return render_moving(slot, scene, age, out);
    SettledVoice& settled = settled_[slot];
    if (!settled.valid) settle(slot);
    if (list(slot, age)) return;
    Window window;
    for (std::size_t k = 0; k < settled.count; ++k) {
      const SettledTap& tap = settled.taps[k];
      const SampleTime low = age + tap.offset;
      if (low + kReadings <= 0 || low >= voice.unit_samples) continue;
      StillTap still{window.of(voice, low, kReadings), tap.weights_gain};
      const spatial::Hrtf::Place& from = places_[slot].arrivals[settled.path[k]];
      deliver(voice.bus, settled.channel[k], from, from, out,
              [&](float* samples) { add_taps({}, std::span(&still, 1), samples); });
    }
  }

  void render_moving(std::size_t slot, const SceneSpan& scene, SampleTime age, const BusSamples& out) noexcept {
    Voice& voice = voices_[slot];
    VoicePlace& place_now = places_[slot];
    unsettle(slot);
    const float gain0 = voice.gain;
    const float gain1 = next_gain(voice);
    if (gain1 == voice.goal) voice.step = 0;
    const bool carried = motions_.moves(voice.bus);
    if (carried) place_now.emitter = motions_.moved(voice.bus, place_now.emitter);
    const bool moves = scene.moves || carried;
    if (moves) voice.last_age = voice.unit_samples + place(place_now.emitter, scene.after, next_, arrivals_);
    const Taps& next = moves ? next_ : place_now.taps;
    const Arrivals& arrivals = moves ? arrivals_ : place_now.arrivals;
    const std::size_t paths = 1 + static_cast<std::size_t>(scene.after.plane_count);
    for (std::size_t c = 0; c < channels_; ++c) {
      for (std::size_t p = 0; p < paths; ++p) {
        Tap from = place_now.taps[c][p];
        Tap to = next[c][p];
        from.gain *= gain0;
        to.gain *= gain1;
        if (std::max(std::abs(from.gain), std::abs(to.gain)) < kInaudible) continue;
        deliver(voice.bus, c, place_now.arrivals[p], arrivals[p], out,
                [&](float* samples) { add_path(voice, age, from, to, samples); });
      }
    }
    for (std::size_t c = 0; moves && c < channels_; ++c)
      std::copy_n(next_[c].begin(), most_paths_, place_now.taps[c].begin());
    if (ears_ && moves) place_now.arrivals = arrivals_;
    voice.gain = gain1;
    if (voice.fading && voice.step == 0) end(slot);
  }

  void end(std::size_t slot) noexcept {
    --(voices_[slot].fading ? fading_ : sounding_);
    slots_.give_back(slot);
    unlisted_.give_back(slot);
  }

  double loudness(std::size_t slot, SampleTime quantum_start) const noexcept {
    const Voice& voice = voices_[slot];
    const int from = static_cast<int>(std::clamp<SampleTime>(quantum_start - voice.onset, 0, voice.unit_samples));
    const int count = std::min(voice.unit_samples - from, static_cast<int>(kGlance_s * rate_hz_));
    float heard = 0;
    for (std::size_t c = 0; c < channels_; ++c) {
      for (std::size_t p = 0; p < most_paths_; ++p) heard = std::max(heard, std::abs(places_[slot].taps[c][p].gain));
    }
    const double gain = static_cast<double>(heard) * static_cast<double>(voice.goal);
    return static_cast<double>(energy(voice.unit + from, count)) * gain * gain;
  }

  void steal(SampleTime quantum_start) noexcept {
    if (!judged_) slots_.each([&](std::size_t slot) { loudness_[slot] = loudness(slot, quantum_start); });
    judged_ = true;
    std::size_t quietest = voices_.size();
    slots_.each([&](std::size_t slot) {
      if (voices_[slot].fading) return;
      if (quietest == voices_.size() || loudness_[slot] < loudness_[quietest]) quietest = slot;
    });
    if (quietest == voices_.size() || fading_ >= kFadingVoices) return;
    Voice& voice = voices_[quietest];
    voice.fading = true;
    ramp_to(quietest, 0);
    --sounding_;
    ++fading_;
    ++stolen_;
    if (voice.step == 0) end(quietest);  // silent already
  }

  std::size_t channels_;
  int most_;
  int limit_;  ///< in force, most_ at most
  double rate_hz_;
  int ramp_quanta_;
  Slots slots_;
  std::vector<Voice> voices_;
  std::vector<VoicePlace> places_;
  Slots unlisted_;  ///< taken slots whose taps are not in the lists
  std::vector<SettledVoice> settled_;
  std::vector<SampleTime> inside_to_;  ///< the last quantum start at which a listed voice reads within its unit
  SampleTime first_to_leave_ = kNever;
  std::array<TapList<WholeTap>, spatial::kMaxChannels> whole_;  ///< by channel
  std::array<TapList<StillTap>, spatial::kMaxChannels> still_;
  std::vector<double> loudness_;  ///< of each voice, valid within a quantum once judged_
  EmitterMotions motions_;
  std::optional<EarFilters> ears_;  ///< where the layout is binaural
  std::size_t most_paths_ = 0;      ///< that any voice has had: its taps beyond are silent
  std::array<spatial::Path, kPaths> ways_;
  Taps next_{};        ///< of the voice that moves, at the quantum's end
  Arrivals arrivals_;  ///< likewise
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
