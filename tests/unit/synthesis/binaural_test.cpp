#include <catch2/catch.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include "server/spatial/hrtf_choice.h"
#include "server/spatial/structural_head.h"
#include "server/synthesis/mixer.h"
#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/random.h"

namespace binaural_test {

using namespace rustle::synthesis;
namespace spatial = rustle::spatial;
namespace dsp = rustle::dsp;
using spatial::Vec3;

namespace {

constexpr double kRate_hz = 48000;
constexpr double kPi = std::numbers::pi;
constexpr Bus kBus = bus_of(0, SoundKind::kCrumpling);

std::shared_ptr<const spatial::Hrtf> structural() {
  static const auto head = std::make_shared<const spatial::Hrtf>(spatial::structural_head(kRate_hz));
  return head;
}

/// A mixer for units by hand, heard at the origin, facing y.
struct Stage {
  Mixer mixer;
  SampleTime now = 0;
  std::vector<float> quantum;

  explicit Stage(spatial::Layout layout, std::shared_ptr<const spatial::Hrtf> hrtf = structural())
      : mixer(options(layout, std::move(hrtf))), quantum(mixer.quantum_size()) {
    mixer.apply(ListenerCue{0, 0, {{0, 0, 0}, {0, 1, 0}, {0, 0, 1}}});
  }

  static RenderOptions options(spatial::Layout layout, std::shared_ptr<const spatial::Hrtf> hrtf) {
    RenderOptions out;
    out.layout = layout;
    out.hrtf = std::move(hrtf);
    out.max_sheets = 1;
    return out;
  }

  void play(const std::vector<float>& unit, const Vec3& from_m, SampleTime onset, float gain = 1) {
    CrumpleCue cue;
    cue.start = onset - kQuantum;
    cue.onset = onset;
    cue.event = static_cast<std::uint64_t>(onset);
    cue.bus = kBus;
    cue.unit = unit.data();
    cue.unit_samples = static_cast<std::uint32_t>(unit.size());
    cue.gain = gain;
    cue.emitter.position_m = from_m;
    cue.emitter.normal = spatial::normalized(-from_m, {0, 0, 1});
    mixer.apply(cue);
  }

  std::array<std::vector<float>, 2> run(SampleTime samples) {
    std::array<std::vector<float>, 2> out;
    const auto channels = static_cast<std::size_t>(mixer.channels());
    for (const SampleTime end = now + samples; now < end; now += kQuantum) {
      mixer.render(now, quantum);
      for (std::size_t c = 0; c < 2; ++c) {
        const float* from = quantum.data() + (kBus * channels + std::min(c, channels - 1)) * kQuantum;
        for (int n = 0; n < kQuantum; ++n) out[c].push_back(mixer.sounding(kBus) ? from[n] : 0.0F);
      }
    }
    return out;
  }
};

std::vector<float> noise(std::size_t samples, std::uint64_t seed) {
  dsp::Random random(seed);
  std::vector<float> out(samples);
  for (float& x : out) x = static_cast<float>(0.1 * random.normal());
  return out;
}

std::complex<double> at_frequency(const std::vector<float>& x, double frequency_hz) {
  std::complex<double> sum = 0;
  for (std::size_t n = 0; n < x.size(); ++n)
    sum += static_cast<double>(x[n]) * std::polar(1.0, -2 * kPi * frequency_hz / kRate_hz * static_cast<double>(n));
  return sum;
}

double db(double ratio) {
  return 20 * std::log10(std::max(ratio, 1e-12));
}

}  // namespace

TEST_CASE("A click is heard by each ear as the head's response says, whatever the quantum it falls into") {
  const std::vector<float> click{1.0F};
  for (const auto& from_m : {Vec3{-0.9, 0.3, 0.2}, Vec3{0.2, -1.5, 0.8}, Vec3{0, 2, 0}}) {
    for (const SampleTime onset : {SampleTime{640}, SampleTime{703}, SampleTime{691}}) {
      Stage stage(spatial::Layout::kBinaural);
      stage.play(click, from_m, onset);
      const auto ears = stage.run(2048);
      const auto place = structural()->place(spatial::head_coordinates({{0, 0, 0}, {0, 1, 0}, {0, 0, 1}}, from_m));
      std::vector<float> filter(static_cast<std::size_t>(structural()->taps()));
      for (int ear = 0; ear < 2; ++ear) {
        structural()->filter(place, ear, filter);
        const double delay = static_cast<double>(onset) + structural()->delay_s(place, ear) * kRate_hz;
        for (double f = 200; f < 6000; f *= 1.2) {
          const auto wanted =
              at_frequency(filter, f) * std::polar(1 / spatial::norm(from_m), -2 * kPi * f / kRate_hz * delay);
          const auto heard = at_frequency(ears[static_cast<std::size_t>(ear)], f);
          CHECK(std::abs(heard - wanted) < 0.03 * std::abs(wanted) + 1e-4);
        }
      }
      CHECK(stage.mixer.silent());
    }
  }
}

TEST_CASE("A mirrored scene swaps the ears bit for bit, moving listener and table included") {
  const auto unit = noise(30000, 3);
  std::array<std::array<std::vector<float>, 2>, 2> heard;
  for (const double side : {1.0, -1.0}) {
    Stage stage(spatial::Layout::kBinaural);
    stage.mixer.apply(PlaneCue{0, 0, 0, true, {{0, 0, -0.4}, {0, 0, 1}, 0.8}});
    stage.mixer.apply(ListenerCue{4096, 24000, {{side * 0.4, 0.2, 0}, {0, 1, 0}, {0, 0, 1}}});
    stage.play(unit, {side * 0.7, 0.5, -0.2}, 1000);
    heard[side > 0 ? 0 : 1] = stage.run(32768);
  }
  CHECK(heard[0][0] == heard[1][1]);
  CHECK(heard[0][1] == heard[1][0]);
  CHECK(heard[0][0] != heard[0][1]);
  CHECK(dsp::rms_dbfs(heard[0][1]) > dsp::rms_dbfs(heard[0][0]) + 1);
}

TEST_CASE("Straight ahead the ears together have the mono level") {
  const auto unit = noise(48000, 5);
  for (const std::string_view name : {spatial::kStructuralHrtf, spatial::kKemarHrtf}) {
    const auto head = spatial::load_hrtf(name, kRate_hz);
    if (!head) continue;
    Stage binaural(spatial::Layout::kBinaural, *head), mono(spatial::Layout::kMono);
    for (Stage* stage : {&binaural, &mono}) stage->play(unit, {0, 1, 0}, 640);
    const auto both = binaural.run(50000);
    const auto one = mono.run(50000)[0];
    CHECK(dsp::rms_dbfs(both[0]) == Approx(dsp::rms_dbfs(both[1])).margin(0.6));
    CHECK(dsp::rms_dbfs(both[0]) == Approx(dsp::rms_dbfs(one)).margin(3));  // white noise weighs the treble
  }
}

TEST_CASE("A tone stays a tone while source, listener and table move about the head for a minute: nothing clicks") {
  std::vector<float> tone(480000);
  for (std::size_t n = 0; n < tone.size(); ++n)
    tone[n] = static_cast<float>(0.3 * std::sin(2 * kPi * 1000 / kRate_hz * static_cast<double>(n)));
  Stage stage(spatial::Layout::kBinaural);
  stage.mixer.apply(PlaneCue{0, 0, 0, true, {{0, 0, -0.6}, {0, 0, 1}, 0.9}});
  dsp::Random random(12);
  const auto between = [&](double reach) { return random.uniform(-reach, reach); };
  Vec3 at{0, -0.5, 0}, looks{0, 1, 0}, speed;
  std::vector<float> ear;
  for (int turn = 0; turn < 6; ++turn) {
    stage.play(tone, {0.3, 0.4, 0.1}, stage.now + 640, 1);
    for (int frame = 0; frame < 500; ++frame) {
      speed = 0.95 * speed + Vec3{between(0.002), between(0.002), between(0.001)};
      at = at + speed;
      if (spatial::norm(at) > 1) speed = -0.01 * at;
      looks = spatial::normalized(looks + Vec3{between(0.1), between(0.1), 0}, {0, 1, 0});
      stage.mixer.apply(ListenerCue{stage.now, stage.now + 960, {at, looks, {0, 0, 1}}});
      stage.mixer.apply(PlaneCue{stage.now, stage.now + 960, 0, false, {{0, 0, -0.6 + between(0.01)}, {0, 0, 1}, 0.9}});
      const auto out = stage.run(960);
      ear.insert(ear.end(), out[0].begin(), out[0].end());
    }
  }
  constexpr int kSize = 4096;
  dsp::RealFft fft(kSize);
  double within = 0, beyond = 0;
  for (int turn = 0; turn < 6; ++turn) {
    for (std::size_t from = static_cast<std::size_t>(turn) * 480000 + 9600;
         from + kSize < static_cast<std::size_t>(turn + 1) * 480000; from += kSize / 2) {
      double here = 0, away = 0;
      for (std::size_t n = 0; n < kSize; ++n) {
        const double p = 2 * kPi * static_cast<double>(n) / kSize;
        const double window = 0.35875 - 0.48829 * std::cos(p) + 0.14128 * std::cos(2 * p) - 0.01168 * std::cos(3 * p);
        fft.time()[n] = static_cast<float>(window) * ear[from + n];
      }
      fft.forward();
      for (std::size_t k = 0; k < fft.spectrum().size(); ++k) {
        const double f = static_cast<double>(k) * kRate_hz / kSize;
        (f > 700 && f < 1300 ? here : away) += std::norm(fft.spectrum()[k]);
      }
      within += here;
      beyond += away;
    }
  }
  CHECK(0.5 * db(beyond / within) < -60);
}

TEST_CASE("What comes through the head or from its centre stays finite and bounded") {
  const auto unit = noise(48000, 9);
  Stage stage(spatial::Layout::kBinaural);
  stage.play(unit, {0, 0, 0}, 640);
  stage.mixer.apply(ListenerCue{9600, 19200, {{0.2, 0, 0}, {0, 1, 0}, {0, 0, 1}}});
  stage.mixer.apply(ListenerCue{19200, 28800, {{-0.2, 0, 0}, {0, 1, 0}, {0, 0, 1}}});
  stage.mixer.apply(ListenerCue{28800, 28864, {{1e6, 0, 0}, {0, 1, 0}, {0, 0, 1}}});
  for (const auto& ear : stage.run(60000)) {
    for (const float x : ear) REQUIRE(std::abs(x) < 100);
  }
}

TEST_CASE("Buses ring on by themselves after their last voice, and then there is silence") {
  Stage stage(spatial::Layout::kBinaural);
  const std::vector<float> click{1.0F};
  stage.play(click, {0, 1, 0}, 640);
  stage.run(704);
  CHECK_FALSE(stage.mixer.silent());
  stage.run(640);
  CHECK(stage.mixer.silent());
}

}  // namespace binaural_test
