#include "server/synthesis/friction_noise.h"

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include "server/spatial/hrtf_choice.h"
#include "server/spatial/structural_head.h"
#include "server/spatial/transfer.h"
#include "server/synthesis/material.h"
#include "server/synthesis/mixer.h"
#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/random.h"

namespace friction_noise_test {

using namespace rustle::synthesis;
namespace spatial = rustle::spatial;
namespace dsp = rustle::dsp;
using spatial::Vec3;

namespace {

constexpr std::uint32_t kRate_hz = 48000;
constexpr double kPi = std::numbers::pi;
constexpr Bus kFrictionBus = bus_of(0, SoundKind::kFriction);

/// A mixer for friction cues by hand.
struct Rubbing {
  RenderOptions options;
  Mixer mixer;
  std::vector<float> emission;
  SampleTime now = 0;
  std::vector<float> quantum;

  explicit Rubbing(spatial::Layout layout = spatial::Layout::kMono, int fft_size = 0, Mode mode = Mode::kCorrected,
                   std::shared_ptr<const spatial::Hrtf> hrtf = nullptr)
      : options(make_options(layout, fft_size, mode, std::move(hrtf))),
        mixer(options),
        emission(static_cast<std::size_t>(friction_fft_size(kRate_hz, fft_size) / 2 + 1), 0.01F),
        quantum(mixer.quantum_size()) {}

  static RenderOptions make_options(spatial::Layout layout, int fft_size, Mode mode,
                                    std::shared_ptr<const spatial::Hrtf> hrtf) {
    RenderOptions options;
    options.mode = mode;
    options.rate_hz = kRate_hz;
    options.layout = layout;
    options.max_sheets = 1;
    options.friction_fft_size = fft_size;
    options.hrtf = std::move(hrtf);
    return options;
  }

  FrictionCue cue(std::uint64_t source, const Vec3& position_m, const Vec3& normal) const {
    FrictionCue cue;
    cue.source = source;
    cue.bus = kFrictionBus;
    cue.gain = 1;
    cue.speed_ratio = 1;
    cue.emission = emission.data();
    cue.emitter.position_m = position_m;
    cue.emitter.normal = normal;
    return cue;
  }

  /// From now on, without end.
  void slide(FrictionCue cue) {
    cue.start = cue.end = now;
    mixer.apply(cue);
    cue.start = now + kQuantum;
    cue.end = INT64_MAX / 4;
    mixer.apply(cue);
  }

  std::vector<std::vector<float>> run(SampleTime samples) {
    const auto channels = static_cast<std::size_t>(mixer.channels());
    std::vector<std::vector<float>> out(channels);
    for (const SampleTime end = now + samples; now < end; now += kQuantum) {
      mixer.render(now, quantum);
      for (std::size_t c = 0; c < channels; ++c) {
        const float* from = quantum.data() + (kFrictionBus * channels + c) * kQuantum;
        if (mixer.sounding(kFrictionBus)) {
          out[c].insert(out[c].end(), from, from + kQuantum);
        } else {
          out[c].insert(out[c].end(), kQuantum, 0.0F);
        }
      }
    }
    return out;
  }
};

spatial::Listener listener_at(const Vec3& position_m, const Vec3& forward, const Vec3& up = {0, 0, 1}) {
  return {position_m, forward, up};
}

std::vector<std::complex<float>> spectrum_of(const std::vector<float>& x, std::size_t from, int size) {
  dsp::RealFft fft(size);
  std::copy_n(x.begin() + static_cast<std::ptrdiff_t>(from), size, fft.time().begin());
  fft.forward();
  return {fft.spectrum().begin(), fft.spectrum().end()};
}

/// Welch's mean power, Hann, half overlapped.
std::vector<double> mean_power(const std::vector<float>& x, std::size_t from, int size) {
  dsp::RealFft fft(size);
  std::vector<double> power(static_cast<std::size_t>(size / 2 + 1));
  for (std::size_t at = from; at + static_cast<std::size_t>(size) <= x.size(); at += static_cast<std::size_t>(size / 2)) {
    for (std::size_t n = 0; n < static_cast<std::size_t>(size); ++n) {
      fft.time()[n] = x[at + n] * static_cast<float>(0.5 - 0.5 * std::cos(2 * kPi * static_cast<double>(n) / size));
    }
    fft.forward();
    for (std::size_t k = 0; k < power.size(); ++k) power[k] += std::norm(fft.spectrum()[k]);
  }
  return power;
}

double db(double power_ratio) {
  return 10 * std::log10(std::max(power_ratio, 1e-30));
}

}  // namespace

TEST_CASE("At every FFT size friction has one level and no ripple at its hop") {
  for (int size = kLeastFrictionFft; size <= kMostFrictionFft; size *= 2) {
    Rubbing rubbing(spatial::Layout::kMono, size);
    rubbing.mixer.apply(ListenerCue{0, 0, listener_at({0, 0, 1}, {0, 0, -1}, {0, 1, 0})});
    rubbing.slide(rubbing.cue(1, {0, 0, 0}, {0, 0, 1}));
    const auto x = rubbing.run(12 * kRate_hz)[0];
    CHECK(dsp::rms_dbfs(std::span(x).subspan(kRate_hz)) == Approx(-40).margin(0.3));
    const auto hop = static_cast<std::size_t>(size / 2);
    std::complex<double> ripple = 0;
    double power = 0;
    for (std::size_t n = kRate_hz / hop * hop; n + hop < x.size() / hop * hop; ++n) {
      const double square = static_cast<double>(x[n]) * x[n];
      power += square;
      ripple += square * std::polar(1.0, 2 * kPi * static_cast<double>(n % hop) / static_cast<double>(hop));
    }
    const double depth = 2 * std::abs(ripple) / power;
    const double blocks = static_cast<double>(x.size()) / static_cast<double>(hop);
    const double chance = 3 * std::sqrt(4 / (blocks * static_cast<double>(hop)));  // of the estimate itself
    CHECK(db((1 + depth) / (1 - depth)) < 0.3 + db(1 + chance));
  }
}

TEST_CASE("Sources that rub alike add their powers, in every ear") {
  const auto head = std::make_shared<const spatial::Hrtf>(spatial::structural_head(kRate_hz));
  for (const spatial::Layout layout : {spatial::Layout::kMono, spatial::Layout::kStereo, spatial::Layout::kBinaural}) {
    std::array<double, 2> level_db{};
    for (const int count : {1, 8}) {
      Rubbing rubbing(layout, 0, Mode::kCorrected, head);
      rubbing.mixer.apply(ListenerCue{0, 0, listener_at({0, 0, 1}, {0, 0, -1}, {0, 1, 0})});
      for (int k = 0; k < count; ++k)
        rubbing.slide(rubbing.cue(100 + static_cast<std::uint64_t>(k), {0.2, 0, 0}, {0, 0, 1}));
      const auto x = rubbing.run(20 * kRate_hz)[0];
      level_db[count == 1 ? 0 : 1] = dsp::rms_dbfs(std::span(x).subspan(kRate_hz));
    }
    CHECK(level_db[1] - level_db[0] == Approx(9.03).margin(0.3));
  }
}

TEST_CASE("Eq. 6 in frequency is eq. 5 in time: half a dB in bands of four bins, over a hundred geometries") {
  constexpr int kSamples = 1 << 19;
  constexpr std::size_t kSettled = 24576;
  dsp::Random random(21);
  const auto point = [&](double reach, double low, double high) {
    return Vec3(random.uniform(-reach, reach), random.uniform(-reach, reach), random.uniform(low, high));
  };
  double worst_db = 0;
  for (int geometry = 0; geometry < 100; ++geometry) {
    const Vec3 emitter_m = point(0.5, 0.02, 0.8), listener_m = point(2, 0.2, 2);
    const Vec3 normal = spatial::normalized({random.normal(), random.normal(), random.normal()}, {0, 0, 1});
    std::vector<spatial::Plane> planes{{{0, 0, 0}, {0, 0, 1}, random.uniform(0.3, 1)}};
    if (geometry % 2 == 1) planes.push_back({{0, -3, 0}, {0, 1, 0}, random.uniform(0.3, 1)});
    const auto source = static_cast<std::uint64_t>(geometry + 1);

    Rubbing alone, among;
    alone.mixer.apply(ListenerCue{0, 0, listener_at(emitter_m + Vec3{0, 0, 1}, {0, 0, -1}, {0, 1, 0})});
    alone.slide(alone.cue(source, emitter_m, {0, 0, 1}));
    among.mixer.apply(ListenerCue{0, 0, listener_at(listener_m, {0, 1, 0})});
    for (std::size_t k = 0; k < planes.size(); ++k) {
      among.mixer.apply(PlaneCue{0, 0, static_cast<std::uint16_t>(k), true, planes[k]});
    }
    among.slide(among.cue(source, emitter_m, normal));

    std::array<spatial::Path, spatial::kMaxPaths> ways;
    const std::size_t count =
        spatial::paths(among.cue(source, emitter_m, normal).emitter, {listener_m}, listener_m, planes, ways);
    const auto x = spectrum_of(alone.run(kSamples + kSettled)[0], kSettled, kSamples);
    const auto y = spectrum_of(among.run(kSamples + kSettled)[0], kSettled, kSamples);
    constexpr std::size_t kBand = 4 * kSamples / 1024;
    for (std::size_t low = kBand; low + kBand < kSamples / 2 * 2 / 3; low += kBand) {
      double in_time = 0, in_frequency = 0;
      for (std::size_t k = low; k < low + kBand; ++k) {
        const double f = static_cast<double>(k) * kRate_hz / kSamples;
        std::complex<double> transfer = 0;
        for (std::size_t p = 0; p < count; ++p) transfer += ways[p].gain * std::polar(1.0, -2 * kPi * f * ways[p].delay_s);
        in_time += std::norm(transfer * std::complex<double>(x[k]));
        in_frequency += std::norm(std::complex<double>(y[k]));
      }
      worst_db = std::max(worst_db, std::abs(db(in_frequency / in_time)));
    }
  }
  CHECK(worst_db < 0.5);
}

TEST_CASE("The comb of a wall has its notches where the geometry puts them, within 2 %") {
  for (const double distance_m : {0.15, 0.4, 1.0}) {
    Rubbing rubbing;
    const Vec3 listener_m{1, 0, 0};
    rubbing.mixer.apply(ListenerCue{0, 0, listener_at(listener_m, {-1, 0, 0})});
    rubbing.mixer.apply(PlaneCue{0, 0, 0, true, {{-distance_m, 0, 0}, {1, 0, 0}, 1}});
    rubbing.slide(rubbing.cue(5, {0, 0, 0}, {1, 0, 0}));
    const auto power = mean_power(rubbing.run(60 * kRate_hz)[0], kRate_hz, 4096);
    // The image radiates with the opposite sign: nothing is heard where the detour is whole wavelengths.
    const double spacing_hz = 343 / (2 * distance_m), bin_hz = kRate_hz / 4096.0;
    int found = 0;
    for (int k = 1; k * spacing_hz < 12000; ++k) {
      if (k * spacing_hz < 400) continue;
      const auto first = static_cast<std::size_t>((k - 0.3) * spacing_hz / bin_hz);
      const auto last = static_cast<std::size_t>((k + 0.3) * spacing_hz / bin_hz);
      double up = 0, sum = 0, sum_x = 0, sum_xx = 0, sum_xxx = 0, sum_xxxx = 0, up_x = 0, up_xx = 0;  // fit of a parabola
      for (std::size_t n = first; n <= last; ++n) {
        const double x = static_cast<double>(n) * bin_hz / spacing_hz - k;
        sum += 1, sum_x += x, sum_xx += x * x, sum_xxx += x * x * x, sum_xxxx += x * x * x * x;
        up += power[n], up_x += power[n] * x, up_xx += power[n] * x * x;
      }
      const double mean = up / sum;
      const double slope = (up_x - mean * sum_x) / sum_xx;  // x is centred but for rounding
      const double bend = (up_xx - mean * sum_xx) / (sum_xxxx - sum_xx * sum_xx / sum);
      CHECK(bend > 0);
      CHECK(std::abs(-0.5 * slope / bend) < 0.02 * k);
      ++found;
    }
    CHECK(found >= 10);
  }
}

TEST_CASE("Friction of one band stays in it while all moves at random for a minute: nothing clicks") {
  const auto head = std::make_shared<const spatial::Hrtf>(spatial::structural_head(kRate_hz));
  for (const spatial::Layout layout : {spatial::Layout::kStereo, spatial::Layout::kBinaural}) {
    Rubbing rubbing(layout, 0, Mode::kCorrected, head);
    std::fill(rubbing.emission.begin(), rubbing.emission.end(), 0.0F);
    for (std::size_t k = 84; k < 88; ++k) rubbing.emission[k] = 0.2F;  // 3.94 to 4.08 kHz
    dsp::Random random(4);
    std::vector<float> left;
    const auto step = [&](double reach) { return Vec3(random.uniform(-reach, reach), random.uniform(-reach, reach), 0); };
    spatial::Listener listener = listener_at({0, -0.8, 0.5}, {0, 1, 0});
    rubbing.mixer.apply(ListenerCue{0, 0, listener});
    spatial::Plane table{{0, 0, -0.05}, {0, 0, 1}, 0.9};
    rubbing.mixer.apply(PlaneCue{0, 0, 0, true, table});
    std::array<Vec3, 3> places{Vec3{0, 0, 0}, Vec3{0.1, 0, 0.1}, Vec3{-0.1, 0.1, 0.05}};
    for (int frame = 0; frame < 60 * 60; ++frame) {
      const SampleTime end = rubbing.now + 832;
      for (std::size_t k = 0; k < places.size(); ++k) {
        places[k] = places[k] + step(0.01);
        places[k].z = std::clamp(places[k].z + random.uniform(-0.005, 0.005), 0.0, 0.3);
        FrictionCue cue =
            rubbing.cue(k + 1, places[k], spatial::normalized({random.normal(), random.normal(), 3}, {0, 0, 1}));
        cue.start = rubbing.now;
        cue.end = end;
        cue.gain = static_cast<float>(random.uniform(0.1, 1));
        cue.speed_ratio = 1;
        cue.gain_sigma = 0.35F;
        cue.gain_cutoff_hz = 80;
        cue.emitter.covariance_m2.zz = 1e-5;
        rubbing.mixer.apply(cue);
      }
      listener.position_m = listener.position_m + step(0.01);
      listener.forward = spatial::normalized(listener.forward + step(0.05), {0, 1, 0});
      rubbing.mixer.apply(ListenerCue{rubbing.now, end, listener});
      table.point_m.z = std::clamp(table.point_m.z + random.uniform(-0.002, 0.002), -0.2, -0.02);
      rubbing.mixer.apply(PlaneCue{rubbing.now, end, 0, false, table});
      const auto out = rubbing.run(832);
      left.insert(left.end(), out[0].begin(), out[0].end());
    }
    const auto power = mean_power(left, 0, 8192);
    double within = 0, beyond = 0;
    for (std::size_t k = 0; k < power.size(); ++k) {
      const double f = static_cast<double>(k) * kRate_hz / 8192;
      (f > 2000 && f < 8000 ? within : beyond) += power[k];
    }
    CHECK(db(beyond / within) < -60);
  }
}

TEST_CASE("Binaural friction reaches each ear through its response: earlier and louder on its side") {
  for (const std::string_view name : {spatial::kStructuralHrtf, spatial::kKemarHrtf}) {
    const auto head = spatial::load_hrtf(name, kRate_hz);
    if (!head) continue;
    const Vec3 listener_m{0, -1, 0.5}, emitter_m{-0.8, -0.4, 0.6};
    Rubbing binaural(spatial::Layout::kBinaural, 0, Mode::kCorrected, *head), mono;
    for (Rubbing* rubbing : {&binaural, &mono}) {
      rubbing->mixer.apply(ListenerCue{0, 0, listener_at(listener_m, {0, 1, 0})});
      rubbing->slide(rubbing->cue(9, emitter_m, spatial::normalized(listener_m - emitter_m, {0, 0, 1})));
    }
    constexpr int kSamples = 1 << 16;
    constexpr std::size_t kSettled = 9600;
    const auto both = binaural.run(kSamples + kSettled);
    const auto x = spectrum_of(mono.run(kSamples + kSettled)[0], kSettled, kSamples);
    const auto place = (*head)->place(spatial::head_coordinates(listener_at(listener_m, {0, 1, 0}), emitter_m - listener_m));
    std::vector<float> filter(static_cast<std::size_t>((*head)->taps()));
    for (int ear = 0; ear < 2; ++ear) {
      const auto y = spectrum_of(both[static_cast<std::size_t>(ear)], kSettled, kSamples);
      (*head)->filter(place, ear, filter);
      constexpr std::size_t kBand = 4 * kSamples / 1024;
      for (std::size_t low = kBand; low + kBand < kSamples / 3; low += kBand) {
        double wanted = 0, heard = 0;
        std::complex<double> cross = 0;
        for (std::size_t k = low; k < low + kBand; ++k) {
          const double w = 2 * kPi * static_cast<double>(k) / kSamples;
          std::complex<double> response = 0;
          if (k % 8 == 0) {
            for (std::size_t n = 0; n < filter.size(); ++n)
              response += static_cast<double>(filter[n]) * std::polar(1.0, -w * static_cast<double>(n));
            response *= std::polar(1.0, -w * kRate_hz * (*head)->delay_s(place, ear));
            const auto expected = response * std::complex<double>(x[k]);
            wanted += std::norm(expected);
            heard += std::norm(std::complex<double>(y[k]));
            cross += std::conj(expected) * std::complex<double>(y[k]);
          }
        }
        CHECK(std::abs(db(heard / wanted)) < 0.7);
        CHECK(std::abs(std::arg(cross)) < 0.15);
      }
    }
    CHECK(dsp::rms_dbfs(both[0]) > dsp::rms_dbfs(both[1]) + 3);
  }
}

}  // namespace friction_noise_test
