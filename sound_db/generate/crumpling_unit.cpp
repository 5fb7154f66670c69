#include "sound_db/generate/crumpling_unit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "sound_db/dsp/filter.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/statistics.h"
#include "sound_db/pack/levels.h"

namespace rustle::generate {

namespace {

using std::numbers::pi;

constexpr double kAftershocks = 24.0, kEnergyExponent = 1.4;
constexpr double kAfterFrom_s = 0.004, kAfterTo_s = 0.35;
constexpr double kMostOfSnap = 0.25, kFade = 0.25;
constexpr double kModes_db = -9.0, kBrush_db = -8.0, kWay_db = -20.0;
constexpr double kSmallFlap_hz = 10000.0;
constexpr int kParts = 7;
constexpr int kMostModes = 12;
constexpr double kTilt_hz = 3000.0;
constexpr double kClacPeak_db = -11.0, kClacSpread_db = 3.0;
constexpr double kClac_s = 0.03, kRub_db = -26.0, kRub_s = 0.008;
constexpr double kClac_hz = 4250.0, kClacFrom_hz = 3800.0, kClacTo_hz = 6800.0;

/// A part of a sheet, or a facet, unlike its neighbours.
Response scattered(const Response& typical, double corner_spread, double formant_db, dsp::Random& random) {
  Response part = typical;
  part.corner_hz *= std::exp(corner_spread * random.normal());
  for (Formant& f : part.formants) {
    f = {random.log_uniform(0.25, 2.0) * typical.corner_hz, formant_db * random.normal(), random.uniform(0.2, 0.7)};
  }
  return part;
}

double energy(std::span<const float> signal) {
  double sum = 0;
  for (const float x : signal) sum += static_cast<double>(x) * x;
  return sum;
}

void add(std::span<float> out, std::span<const float> signal, double gain, std::size_t at = 0) {
  for (std::size_t n = at; n < out.size() && n - at < signal.size(); ++n) {
    out[n] += static_cast<float>(gain) * signal[n - at];
  }
}

/// Adds `layer` with an energy of `level_db` below `of_energy`.
void add_layer(std::span<float> out, std::span<const float> layer, double of_energy, double level_db) {
  const double there = energy(layer);
  if (there > 0) add(out, layer, dsp::db_to_gain(level_db) * std::sqrt(of_energy / there));
}

void fade_in(std::span<float> signal, double seconds, double rate_hz) {
  const auto length = std::min(signal.size(), static_cast<std::size_t>(seconds * rate_hz));
  for (std::size_t n = 0; n < length; ++n) signal[n] *= static_cast<float>(n) / static_cast<float>(length);
}

void fade_out(std::span<float> signal, double seconds, double rate_hz) {
  const auto length = std::min(signal.size(), static_cast<std::size_t>(seconds * rate_hz));
  for (std::size_t n = 0; n < length; ++n) {
    signal[signal.size() - length + n] *= static_cast<float>(0.5 * (1 + std::cos(pi * static_cast<double>(n + 1) / length)));
  }
}

/// H(s) = (√g s + ω) / (s + √g ω): 1/√g at low and √g at high frequencies, 1 at kTilt_hz.
std::vector<float> tilted(std::span<const float> signal, double gain_db, double rate_hz) {
  const double root = dsp::db_to_gain(gain_db / 2), t = std::tan(pi * kTilt_hz / rate_hz), over = 1 / (1 + root * t);
  dsp::Cascade shelf;
  shelf.count = 1;
  shelf.sections[0] = {(root + t) * over, (t - root) * over, 0, (root * t - 1) * over, 0};
  std::vector<float> out(signal.begin(), signal.end());
  dsp::CascadeState state;
  dsp::filter(shelf, state, out);
  return out;
}

double centroid_hz(std::span<const float> signal, double rate_hz) {
  return dsp::spectral_centroid_hz(dsp::mean_magnitude(signal, 1024, 256), rate_hz);
}

/// The signal through the shelf that gives it this centroid, within 0.1 %; at most 18 dB either way.
std::vector<float> brought_to_centroid(const std::vector<float>& signal, double wanted_hz, double rate_hz) {
  double low_db = -18, high_db = 18;
  std::vector<float> out;
  for (int i = 0; i < 14; ++i) {
    const double middle_db = (low_db + high_db) / 2;
    out = tilted(signal, middle_db, rate_hz);
    const double off = centroid_hz(out, rate_hz) / wanted_hz - 1;
    if (std::abs(off) < 1e-3) break;
    (off > 0 ? high_db : low_db) = middle_db;
  }
  return out;
}

std::vector<float> lowest_modes(const Paper& paper, const pack::GridPoint& point, double snap_s, std::size_t length,
                                double rate_hz, dsp::Random& random) {
  std::vector<float> out(length, 0.0f);
  int taken = 0;
  for (const double mode :
       strip_modes_hz(paper, point.ruling_length_m, point.free_border_length_m / 2, kFlapCompression, 400)) {
    if (mode <= 40) continue;
    if (taken++ == kMostModes) break;
    const double phase = 2 * pi * random.uniform(), rate = 6.907755 / std::min(0.8, decay_s(paper, mode));
    for (auto n = static_cast<std::size_t>(snap_s * rate_hz); n < length; ++n) {
      const double t = static_cast<double>(n) / rate_hz - snap_s;
      const double attack = std::clamp(t / 0.003, 0.0, 1.0);
      out[n] += static_cast<float>(mode / 100 * attack * std::sin(2 * pi * mode * t + phase) * std::exp(-rate * t));
    }
  }
  return out;
}

/// exp(0.35 g), g Gaussian of unit variance under two equal one-pole low-passes.
std::vector<float> slow_gain(double cutoff_hz, std::size_t length, double rate_hz, dsp::Random& random) {
  const double a = std::exp(-2 * pi * cutoff_hz / rate_hz), keep = 1 - a;
  const double deviation = std::sqrt(std::pow(keep, 4) * (1 + a * a) / std::pow(1 - a * a, 3));
  double first = 0, second = 0;
  const auto step = [&] {
    first = a * first + keep * random.normal();
    second = a * second + keep * first;
    return second;
  };
  for (int i = 0; i < static_cast<int>(8 / keep); ++i) step();
  std::vector<float> gain(length);
  for (float& g : gain) g = static_cast<float>(std::exp(0.35 * step() / deviation));
  return gain;
}

}  // namespace

double flap_corner_hz(const Paper& paper, const pack::GridPoint& point) {
  const double law_hz =
      5200.0 * std::pow(point.ruling_length_m / 0.1, -0.4) * std::pow(point.free_border_length_m / 0.2, -0.33);
  return brightness(paper) * levelled_off(law_hz, kSmallFlap_hz);
}

double flap_centroid_hz(const Paper& paper, const pack::GridPoint& point) {
  Response sheet;
  sheet.corner_hz = flap_corner_hz(paper, point);
  double weighted = 0, total = 0;
  for (double f = 50; f <= 15000; f += 50) {
    weighted += f * sheet.shape(f);
    total += sheet.shape(f);
  }
  return weighted / total;
}

double flap_way_s(const Paper& paper, const pack::GridPoint& point) {
  const auto modes_hz = strip_modes_hz(paper, point.ruling_length_m, point.free_border_length_m / 2, kFlapCompression, 1000);
  return modes_hz.empty() ? 0.003 : std::clamp(0.125 / modes_hz.front(), 0.003, 0.025);
}

std::vector<float> flap(const Paper& paper, const pack::GridPoint& point, double rate_hz, dsp::Random random,
                        Workspace& workspace) {
  Response sheet;
  sheet.corner_hz = flap_corner_hz(paper, point);
  const double size = point.disc_radius_m() / pack::kReferencePoint.disc_radius_m();
  const double way_s = flap_way_s(paper, point);
  const double spread_s = kAfterTo_s * std::clamp(size, 0.5, 1.5);
  const double ring_s = std::clamp(decay_s(paper, 0.08 * sheet.corner_hz), 0.12, 0.8);
  const auto length = static_cast<std::size_t>(std::clamp(way_s + spread_s + 0.6 * ring_s, 0.2, 0.8) * rate_hz);

  const Ringing ringing;
  std::array<std::vector<float>, kParts> answers;
  for (auto& answer : answers) {
    answer = blow(scattered(sheet, 0.3, 5.0, random), paper, ringing, length, rate_hz, random, workspace);
    const double whole = energy(answer);
    for (float& x : answer) x /= static_cast<float>(std::sqrt(whole));
  }
  std::vector<float> out(length, 0.0f);
  const auto strike = [&](double time_s, double with_energy, int part) {
    const double gain = (random.index(2) ? 1 : -1) * std::sqrt(with_energy);
    add(out, answers[static_cast<std::size_t>(part)], gain, static_cast<std::size_t>(std::max(0.0, time_s) * rate_hz));
  };
  const auto anywhere = [&] { return static_cast<int>(random.index(kParts)); };

  strike(way_s, 0.6, 0);
  strike(way_s + random.uniform(0.0002, 0.002), 0.25, 1);
  strike(way_s + random.uniform(0.0002, 0.002), 0.15, 2);

  struct Shock {
    double time_s, energy;
  };
  std::vector<Shock> after(static_cast<std::size_t>(std::max(8.0, std::round(kAftershocks * paper.crackle * size))));
  double sum = 0;
  for (Shock& shock : after) {
    shock.time_s = random.log_uniform(kAfterFrom_s, spread_s);
    shock.energy = random.truncated_pareto(kEnergyExponent, 1e-4, 1.0) * std::exp(-shock.time_s / (kFade * spread_s));
    sum += shock.energy;
  }
  for (const Shock& shock : after) {
    const double most = kMostOfSnap * std::exp(-shock.time_s / (kFade * spread_s));
    strike(way_s + shock.time_s, std::min(most, paper.crackle * shock.energy / sum), anywhere());
  }
  const double struck = energy(out);

  const int early = 2 + static_cast<int>(std::round(4 * paper.crackle * std::min(1.0, size)));
  for (int i = 0; i < early; ++i) {
    const double u = random.uniform();
    strike(way_s * (1 - u * u), random.truncated_pareto(kEnergyExponent, 3e-4, 0.02), anywhere());
  }

  auto moving = shaped_noise(scattered(sheet, 0.3, 5.0, random), ringing.from_hz, length, rate_hz, random, workspace);
  const auto wavering = slow_gain(60, length, rate_hz, random);
  std::vector<float> way(length, 0.0f);
  for (std::size_t n = 0; n < length; ++n) {
    const double t = static_cast<double>(n) / rate_hz - way_s;
    const double noise = moving[n] * wavering[n];
    if (t < 0) way[n] = static_cast<float>(noise * (0.2 + 0.8 * std::pow(1 + t / way_s, 2)));
    moving[n] = static_cast<float>(t < 0 ? 0 : noise * std::min(1.0, t / 0.01) * std::exp(-t / (kFade * spread_s)));
  }
  add_layer(out, way, struck, kWay_db);
  add_layer(out, moving, struck, kBrush_db - dsp::gain_to_db(paper.crackle) / 2);
  add_layer(out, lowest_modes(paper, point, way_s, length, rate_hz, random), struck, kModes_db);

  out = brought_to_centroid(out, flap_centroid_hz(paper, point), rate_hz);
  fade_in(out, 0.0005, rate_hz);
  fade_out(out, 0.03, rate_hz);
  const auto gain = static_cast<float>(std::sqrt(size) / dsp::peak(out));
  for (float& x : out) x *= gain;
  return out;
}

std::vector<float> clac(const Paper& paper, double rate_hz, dsp::Random random, Workspace& workspace) {
  const auto length = static_cast<std::size_t>(kClac_s * rate_hz);
  std::vector<float> out(length, 0.0f);
  const auto facets = 1 + random.index(4);
  for (std::uint32_t k = 0; k < facets; ++k) {
    const double facet_m = random.log_uniform(0.005, 0.025);
    Response facet;
    facet.corner_hz = brightness(paper) * 8000.0 * std::pow(facet_m / 0.005, -0.86);
    facet.low_hz = 0.4 * facet.corner_hz;
    facet.low_order = 2;
    facet.slope = 2.0;
    facet = scattered(facet, 0.15, 5.0, random);
    const double start_s = k == 0 ? 0.0 : random.uniform(0.0005, 0.004);
    const double relative = facet_m / 0.015;
    const double strength = relative * (k == 0 ? 1.0 : random.truncated_pareto(kEnergyExponent, 0.03, 1.0));
    const double crack_share = random.uniform(0.1, 0.35);
    const auto at = static_cast<std::size_t>(start_s * rate_hz);
    const auto crack = blow(facet, paper, {0.1, 0.013, 300}, length, rate_hz, random, workspace);
    const auto ring = blow(facet, paper, {1.0, 0.013, 300}, length, rate_hz, random, workspace);
    add(out, crack, std::sqrt(strength * crack_share / energy(crack)), at);
    add(out, ring, std::sqrt(strength * (1 - crack_share) / energy(ring)), at);
  }
  Response rubbing;
  rubbing.corner_hz = brightness(paper) * 5000.0;
  auto rub = shaped_noise(rubbing, 300, length, rate_hz, random, workspace);
  const double fading = std::exp(-1 / (kRub_s * rate_hz));
  double level = 1;
  for (float& x : rub) x *= static_cast<float>(level), level *= fading;
  add_layer(out, rub, energy(out), kRub_db);
  const double half_way_hz = std::sqrt(centroid_hz(out, rate_hz) * kClac_hz * std::pow(brightness(paper), 0.75));
  out = brought_to_centroid(out, std::clamp(half_way_hz, kClacFrom_hz, kClacTo_hz), rate_hz);
  fade_in(out, 0.0002, rate_hz);
  fade_out(out, 0.005, rate_hz);
  const double peak_db =
      kClacPeak_db + std::clamp(kClacSpread_db * random.normal(), -2 * kClacSpread_db, 2 * kClacSpread_db);
  const auto gain = static_cast<float>(dsp::db_to_gain(peak_db) / dsp::peak(out));
  for (float& x : out) x *= gain;
  return out;
}

}  // namespace rustle::generate
