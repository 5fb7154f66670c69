#include "server/synthesis/tear_noise.h"

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "server/spatial/structural_head.h"
#include "server/synthesis/emitter_sounds.h"
#include "server/synthesis/resonator_level.h"
#include "server/synthesis/source_paths.h"
#include "server/synthesis/tear_colour.h"
#include "server/synthesis/tear_gate.h"
#include "server/synthesis/tearing.h"
#include "sound_db/dsp/fft.h"
#include "tests/unit/synthesis/rig.h"

namespace tear_noise_test {

using namespace rustle::synthesis;
using namespace rustle::synthesis::rig;
namespace spatial = rustle::spatial;
namespace dsp = rustle::dsp;
namespace observation = rustle::observation;

namespace {

constexpr double kFrame_s = 1.0 / 60;

observation::TearEvent tear(std::uint64_t id, double speed_m_per_s,
                            std::vector<observation::Resonator> resonators = {bent_resonator()}) {
  observation::TearEvent event;
  event.id = id;
  event.speed_m_per_s = speed_m_per_s;
  event.resonators = std::move(resonators);
  return event;
}

/// Frames from 0 to end_s with a tear of that speed at their times.
template <class Speed>
void tear_on(Rig& rig, double end_s, Speed&& speed, std::uint64_t id = 1) {
  for (int k = 1; k * kFrame_s <= end_s + 1e-9; ++k) {
    auto o = rig.frame((k - 1) * kFrame_s, k * kFrame_s);
    o.tears = {tear(id, speed(k * kFrame_s))};
    rig.planner.plan(o, 0, rig.cues);
  }
}

void tear_steadily(Rig& rig, double end_s, double speed_m_per_s) {
  tear_on(rig, end_s, [&](double) { return speed_m_per_s; });
}

std::vector<float> heard(Rig& rig, double seconds) {
  rig.hand_over();
  return rig.run(static_cast<SampleTime>(seconds * rig.render_options.rate_hz))[0];
}

std::vector<float> steady(double speed_m_per_s, double seconds, const PackOptions& pack = {}, Mode mode = Mode::kCorrected) {
  Rig rig(pack, mode);
  tear_steadily(rig, seconds + 0.1, speed_m_per_s);
  auto samples = heard(rig, seconds + 0.05);
  samples.erase(samples.begin(), samples.begin() + static_cast<std::ptrdiff_t>(0.05 * pack.rate_hz));
  return samples;
}

double kurtosis(const std::vector<float>& x) {
  double square = 0, fourth = 0;
  for (const float v : x) {
    const double v2 = static_cast<double>(v) * v;
    square += v2 / static_cast<double>(x.size());
    fourth += v2 * v2 / static_cast<double>(x.size());
  }
  return fourth / (square * square);
}

/// Mean power density by blocks of 1024 between two frequencies, in dB.
double band_db(const std::vector<float>& x, double low_hz, double high_hz, double rate_hz = 48000) {
  constexpr int kSize = 1024;
  dsp::RealFft fft(kSize);
  double sum = 0;
  int count = 0;
  for (std::size_t at = 0; at + kSize <= x.size(); at += kSize / 2) {
    for (std::size_t n = 0; n < kSize; ++n)
      fft.time()[n] =
          x[at + n] * static_cast<float>(0.5 - 0.5 * std::cos(2 * std::numbers::pi * static_cast<double>(n) / kSize));
    fft.forward();
    for (std::size_t k = 0; k <= kSize / 2; ++k) {
      const double f = static_cast<double>(k) * rate_hz / kSize;
      if (f < low_hz || f > high_hz) continue;
      sum += static_cast<double>(std::norm(fft.spectrum()[k]));
      ++count;
    }
  }
  return 10 * std::log10(sum / count);
}

}  // namespace

TEST_CASE("Tearing at 0.1 m/s has an RMS of -32 dBFS at 1 m on the axis, in both modes, and its level goes with the speed") {
  for (const Mode mode : {Mode::kCorrected, Mode::kPublished}) {
    const double seconds = mode == Mode::kPublished ? 60 : 10;
    CHECK(rms_db(steady(0.1, seconds, {}, mode)) == Approx(-32).margin(mode == Mode::kPublished ? 2.0 : 0.5));
  }
  const double slow_db = rms_db(steady(0.05, 10)), fast_db = rms_db(steady(1, 10));
  CHECK((fast_db - slow_db) / (20 * std::log10(20)) == Approx(1).margin(0.1));
}

TEST_CASE("The sound of a tear keeps its level at other rates") {
  PackOptions pack;
  for (const std::uint32_t rate_hz : {44100U, 96000U}) {
    pack.rate_hz = rate_hz;
    CHECK(rms_db(steady(0.1, 10, pack)) == Approx(-32).margin(0.5));
  }
}

TEST_CASE("Tears are flat from 1 to 8 kHz and fall above, and as peaky as real ones") {
  const auto samples = steady(0.2, 20);
  double least = 1e9, most = -1e9;
  for (double f = 1000; f < 8200; f *= std::cbrt(2.0)) {
    const double level = band_db(samples, f / 1.12, f * 1.12);
    least = std::min(least, level);
    most = std::max(most, level);
  }
  CHECK(most - least < 6);
  CHECK(band_db(samples, 11000, 14000) < least);
  CHECK(band_db(samples, 16000, 20000) < least - 6);
  CHECK(kurtosis(samples) > 5);
  CHECK(kurtosis(samples) < 15);
}

TEST_CASE("At double the speed one seed's breaks come in half the time") {
  // Envelopes over the torn length: 0.2 mm at a time.
  const auto envelope = [](double speed_m_per_s) {
    Rig rig;
    tear_steadily(rig, 0.3 / speed_m_per_s, speed_m_per_s);
    const auto samples = heard(rig, 0.25 / speed_m_per_s);
    const double step = 2e-4 / speed_m_per_s * 48000;
    // In the first frame's ramp the tear goes half as far.
    const double first = 0.5 * kFrame_s * 48000 + kPathLag;
    std::vector<double> out;
    for (int k = 50; k < 1000; ++k) {
      double sum = 0;
      const auto from = static_cast<std::size_t>(first + k * step), to = static_cast<std::size_t>(first + (k + 1) * step);
      for (std::size_t n = from; n < to; ++n) sum += static_cast<double>(samples[n]) * samples[n];
      out.push_back(std::log(1e-12 + sum / speed_m_per_s));
    }
    return out;
  };
  const auto correlation = [](const std::vector<double>& a, const std::vector<double>& b) {
    double ma = 0, mb = 0, ab = 0, aa = 0, bb = 0;
    for (std::size_t k = 0; k < a.size(); ++k)
      ma += a[k] / static_cast<double>(a.size()), mb += b[k] / static_cast<double>(a.size());
    for (std::size_t k = 0; k < a.size(); ++k) {
      ab += (a[k] - ma) * (b[k] - mb);
      aa += (a[k] - ma) * (a[k] - ma);
      bb += (b[k] - mb) * (b[k] - mb);
    }
    return ab / std::sqrt(aa * bb);
  };
  const auto slow = envelope(0.05), fast = envelope(0.1);
  const auto shifted = std::vector<double>(fast.begin() + 10, fast.end());
  CHECK(correlation(slow, fast) > 0.6);
  CHECK(correlation(std::vector<double>(slow.begin(), slow.end() - 10), shifted) < 0.3);
}

TEST_CASE("Grammage, the sheet's or else its pack's, scales the level of tears; as printed it does not") {
  const auto level_db = [](std::optional<double> sent_kg_per_m2, double pack_kg_per_m2, Mode mode) {
    Rig rig({}, mode);
    auto pack = std::make_shared<rustle::pack::SoundPack>(*make_pack({}));
    pack->grammage_kg_per_m2 = pack_kg_per_m2;
    SheetSetup setup{1, 0, pack, {}};
    setup.grammage_kg_per_m2 = sent_kg_per_m2;
    rig.planner.add_sheet(setup, 0, rig.cues);
    tear_steadily(rig, 2, 0.1);
    return rms_db(heard(rig, 2));
  };
  const double printer_db = level_db(std::nullopt, 0.08, Mode::kCorrected);
  CHECK(level_db(std::nullopt, 0.16, Mode::kCorrected) - printer_db == Approx(20 * std::log10(2)).margin(0.01));
  CHECK(level_db(0.04, 0.16, Mode::kCorrected) - printer_db == Approx(-20 * std::log10(2)).margin(0.01));
  CHECK(level_db(0.04, 0.16, Mode::kPublished) == level_db(std::nullopt, 0.08, Mode::kPublished));
}

TEST_CASE("A tear takes its colour from the resonator at its tip, and keeps its level") {
  auto pack = std::make_shared<rustle::pack::SoundPack>(*make_pack({}));
  auto& bent = pack->friction->spectra[0].magnitudes;
  for (std::size_t k = 0; k < bent.size(); ++k) bent[k] = 1 / (1 + static_cast<float>(k) / 40);
  const auto sound = [&](const observation::Resonator& resonator) {
    Rig rig;
    rig.planner.add_sheet({1, 0, pack, {}}, 0, rig.cues);
    for (int k = 1; k <= 300; ++k) {
      auto o = rig.frame((k - 1) * kFrame_s, k * kFrame_s);
      o.tears = {tear(1, 0.3, {bare_resonator({}, 0.02), resonator})};
      rig.planner.plan(o, 0, rig.cues);
    }
    return heard(rig, 5);
  };
  const auto on_flat = sound(bare_resonator({}, 0.01)), on_cone = sound(bent_resonator());
  const auto tilt_db = [](const std::vector<float>& x) { return band_db(x, 500, 1000) - band_db(x, 6000, 8000); };
  const double expected_db = 20 * kTearColour * std::log10((1 + 7000 / 46.875 / 40) / (1 + 750 / 46.875 / 40));
  CHECK(tilt_db(on_cone) - tilt_db(on_flat) == Approx(expected_db).margin(0.7));
  CHECK(rms_db(on_cone) == Approx(rms_db(on_flat)).margin(0.3));
}

TEST_CASE("The colour of a tear has unit energy and minimum phase, whatever the spectrum") {
  std::vector<float> emission(513);
  for (std::size_t k = 0; k < emission.size(); ++k) emission[k] = k < 6 ? 0 : 1 + 0.8F * std::sin(static_cast<float>(k) / 9);
  for (const auto& spectrum : {emission, std::vector<float>{}, std::vector<float>(513, 0.0F)}) {
    const auto filter = tear_colour(spectrum, 48000);
    REQUIRE(filter.size() == static_cast<std::size_t>(tear_colour_taps(48000)));
    double energy = 0, early = 0;
    for (std::size_t n = 0; n < filter.size(); ++n) {
      energy += static_cast<double>(filter[n]) * filter[n];
      if (n < 32) early += static_cast<double>(filter[n]) * filter[n];
    }
    CHECK(energy == Approx(1));
    CHECK(early > 0.85);
  }
}

TEST_CASE("A tip is an episode: silent at rest, ramped when its speed changes, over when it is gone") {
  Rig rig;
  tear_on(rig, 0.5, [](double t) { return t < 0.2 ? 0.2 : t < 0.3 ? 0.0 : 0.4; });
  auto gone = rig.frame(0.5, 0.5 + kFrame_s);
  rig.planner.plan(gone, 0, rig.cues);
  const auto x = heard(rig, 1);
  const auto level_db = [&](double from_s, double to_s) {
    return dsp::rms_dbfs(
        std::span(x).subspan(static_cast<std::size_t>(from_s * 48000), static_cast<std::size_t>((to_s - from_s) * 48000)));
  };
  CHECK(level_db(0.05, 0.19) > -30);
  CHECK(level_db(0.23, 0.28) == dsp::kSilenceDb);
  CHECK(level_db(0.35, 0.49) > -24);
  CHECK(level_db(0.54, 1.0) == dsp::kSilenceDb);
  CHECK(rig.mixer.silent());
  CHECK(rig.mixer.counters().voices == 0);
  // Every frame's level lies between those of a straight ramp: no step.
  CHECK(level_db(0.2, 0.2 + 0.2 * kFrame_s) > level_db(0.2 + 0.6 * kFrame_s, 0.2 + 0.9 * kFrame_s));
}

TEST_CASE("Nothing tears: nothing sounds, not even a resting tip") {
  Rig rig;
  tear_steadily(rig, 0.5, 0);
  CHECK(rig.cues.size() == 1);  // the listener
  CHECK(rms_db(heard(rig, 0.5)) == dsp::kSilenceDb);
}

TEST_CASE("A tear that no cue renews stops by itself, and so does that of a sheet that ends") {
  Rig rig;
  tear_steadily(rig, 0.2, 0.2);
  rig.hand_over();
  const auto x = rig.run(48000)[0];
  CHECK(dsp::rms_dbfs(std::span(x).subspan(48000 * 4 / 10, 2400)) > -32);
  CHECK(dsp::rms_dbfs(std::span(x).subspan(48000 * 53 / 100)) == dsp::kSilenceDb);
  Rig ended;
  tear_steadily(ended, 0.2, 0.2);
  ended.planner.end_sheet(1, 9600, ended.cues);
  const auto y = heard(ended, 0.5);
  CHECK(dsp::rms_dbfs(std::span(y).subspan(48000 * 24 / 100)) == dsp::kSilenceDb);
}

TEST_CASE("Tips are heard each for itself: powers add, and every one has its own breaks") {
  Rig rig;
  for (int k = 1; k <= 300; ++k) {
    auto o = rig.frame((k - 1) * kFrame_s, k * kFrame_s);
    for (std::uint64_t id = 1; id <= 4; ++id) o.tears.push_back(tear(id, 0.2));
    rig.planner.plan(o, 0, rig.cues);
  }
  CHECK(rms_db(heard(rig, 5), 2400) == Approx(-26 + 6).margin(0.7));
}

TEST_CASE("A table's image of a tear comes at its time and gain; a tip that touches has none") {
  const auto echo = [](double height_m) {
    Rig rig;
    const IdentifiedPlane table{1, {}};
    rig.planner.planes(std::span(&table, 1), 0, 0, rig.cues);
    for (int k = 1; k <= 120; ++k) {
      auto o = rig.frame((k - 1) * kFrame_s, k * kFrame_s);
      auto one = tear(1, 0.3);
      one.position_m = {0, 0, height_m};
      o.tears = {one};
      rig.planner.plan(o, 0, rig.cues);
    }
    const auto x = heard(rig, 2);
    // Autocorrelation at the image's delay over the power.
    const auto lag = static_cast<std::size_t>(std::lround(2 * height_m / 343 * 48000));
    double power = 0, product = 0;
    for (std::size_t n = 9600; n + lag < x.size(); ++n) {
      power += static_cast<double>(x[n]) * x[n];
      product += static_cast<double>(x[n]) * x[n + lag];
    }
    return product / power;
  };
  // Mirrored normals: the image has the opposite sign; r = -a / (1 + a²), a the ratio of the distances.
  const double a = 0.7 / 1.3;
  CHECK(echo(0.3) == Approx(-a / (1 + a * a)).margin(0.06));
  CHECK(std::abs(echo(0.001)) > 0.99);  // the lag is 0: nothing but the sound itself
}

TEST_CASE("The same tears make the same samples, whatever is asked for at a time") {
  const auto sound = [](spatial::Layout layout, bool piecemeal) {
    Rig rig({}, Mode::kCorrected, layout);
    tear_on(rig, 0.5, [](double t) { return 0.1 + t; });
    std::vector<float> all;
    if (!piecemeal) {
      rig.hand_over();
      for (const auto& channel : rig.run(24000)) all.insert(all.end(), channel.begin(), channel.end());
      return all;
    }
    std::vector<std::vector<float>> channels(static_cast<std::size_t>(rig.mixer.channels()));
    const auto cues = std::exchange(rig.cues, {});
    std::size_t next = 0;
    for (SampleTime now = 0; now < 24000; now += kQuantum) {
      while (next < cues.size() && start_of(cues[next]) < now + kQuantum) rig.mixer.apply(cues[next++]);
      const auto part = rig.run(kQuantum);
      for (std::size_t c = 0; c < part.size(); ++c) channels[c].insert(channels[c].end(), part[c].begin(), part[c].end());
    }
    for (const auto& channel : channels) all.insert(all.end(), channel.begin(), channel.end());
    return all;
  };
  for (const auto layout : {spatial::Layout::kMono, spatial::Layout::kStereo}) {
    const auto a = sound(layout, false), b = sound(layout, true);
    REQUIRE(a.size() == b.size());
    CHECK(std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0);
  }
}

TEST_CASE("A tip by itself is an emitter, whose dry sound is the mix on the axis") {
  Rig rig;
  tear_steadily(rig, 0.5, 0.2);
  rig.hand_over();
  EmitterSounds sounds(rig.render_options);
  double difference = 0, power = 0;
  for (; rig.now < 24000; rig.now += kQuantum) {
    rig.mixer.render(rig.now, rig.quantum, &sounds);
    const Bus bus = bus_of(0, SoundKind::kTearing);
    if (!rig.mixer.sounding(bus)) continue;
    REQUIRE(sounds.sounds().size() == 1);
    CHECK(kind_of(sounds.sounds()[0].bus) == SoundKind::kTearing);
    for (std::size_t n = 0; n < kQuantum; ++n) {
      const double mix = static_cast<double>(rig.quantum[static_cast<std::size_t>(bus) * kQuantum + n]);
      difference += std::abs(mix - static_cast<double>(sounds.sounds()[0].samples[n]));
      power += mix * mix;
    }
  }
  CHECK(power > 0);
  CHECK(difference < 1e-3);
}

TEST_CASE("A tip and a listener on the move make no click") {
  // A tear of pure tones does not exist; what moves must not raise the highest octave.
  const auto highest_db = [](bool moves) {
    Rig rig;
    for (int k = 1; k <= 240; ++k) {
      auto o = rig.frame((k - 1) * kFrame_s, k * kFrame_s);
      auto one = tear(1, 0.3);
      if (moves) one.position_m = {0.3 * std::sin(0.2 * k), 0.2 * std::cos(0.3 * k), 0.05 * std::sin(0.15 * k)};
      o.tears = {one};
      rig.planner.plan(o, 0, rig.cues);
      if (moves) rig.planner.listener({{0.2 * std::sin(0.1 * k), 0, 1}, {0, 0, -1}, {0, 1, 0}}, k * kFrame_s, 0, rig.cues);
    }
    const auto x = heard(rig, 4);
    return band_db(x, 20000, 24000) - band_db(x, 1000, 8000);
  };
  CHECK(highest_db(true) - highest_db(false) < 1.5);
}

TEST_CASE("Two ears hear a tear on their left louder and earlier on the left") {
  RenderOptions options;
  options.layout = spatial::Layout::kBinaural;
  options.hrtf = std::make_shared<const spatial::Hrtf>(spatial::structural_head(48000));
  options.max_sheets = 1;
  Mixer mixer(options);
  mixer.apply(ListenerCue{0, 0, {{0, 0, 0}, {0, 1, 0}, {0, 0, 1}}});
  TearCue cue;
  cue.end = 480;
  cue.tip = 5;
  cue.bus = bus_of(0, SoundKind::kTearing);
  cue.gain = 0.025F;
  cue.speed_m_per_s = 0.2F;
  cue.emitter.position_m = {-1, 0, 0};
  cue.emitter.normal = {1, 0, 0};
  mixer.apply(cue);
  std::vector<float> quantum(mixer.quantum_size()), left, right;
  for (SampleTime now = 0; now < 12000; now += kQuantum) {
    mixer.render(now, quantum);
    for (std::size_t n = 0; n < kQuantum; ++n) {
      const bool sounds = mixer.sounding(cue.bus);
      left.push_back(sounds ? quantum[static_cast<std::size_t>(cue.bus) * 2 * kQuantum + n] : 0.0F);
      right.push_back(sounds ? quantum[(static_cast<std::size_t>(cue.bus) * 2 + 1) * kQuantum + n] : 0.0F);
    }
  }
  CHECK(rms_db(left) > rms_db(right) + 3);
  double most = 0;
  int best = 0;
  for (int lag = -60; lag <= 60; ++lag) {
    double sum = 0;
    for (int n = 2000; n < 11000; ++n)
      sum += static_cast<double>(left[static_cast<std::size_t>(n)]) * right[static_cast<std::size_t>(n + lag)];
    if (sum > most) most = sum, best = lag;
  }
  CHECK(best > 20);
  CHECK(best < 45);
}

TEST_CASE("Beyond the room for tears new ones are not begun, which is counted; resting tips give way") {
  Rig rig;
  const auto most = static_cast<std::uint64_t>(rig.render_options.max_tears);
  auto o = rig.frame(0, kFrame_s);
  for (std::uint64_t id = 1; id <= most + 3; ++id) o.tears.push_back(tear(id, 0.1));
  rig.planner.plan(o, 0, rig.cues);
  rig.hand_over();
  rig.run(800);
  CHECK(rig.mixer.counters().sources_dropped == 3);
  CHECK(rig.mixer.counters().voices == most);
  o = rig.frame(kFrame_s, 2 * kFrame_s);
  for (std::uint64_t id = 1; id <= most; ++id) o.tears.push_back(tear(id, 0));
  rig.planner.plan(o, 0, rig.cues);
  rig.hand_over();
  rig.run(24000);
  CHECK(rig.mixer.counters().voices == 0);
  o = rig.frame(0.5, 0.6);
  o.tears = {tear(100, 0.1)};
  rig.planner.plan(o, 0, rig.cues);
  rig.hand_over();
  rig.run(4800);
  CHECK(rig.mixer.counters().voices == 1);
  CHECK(rig.mixer.counters().sources_dropped == 3);
}

}  // namespace tear_noise_test
