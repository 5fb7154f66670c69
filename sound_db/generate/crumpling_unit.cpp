#include "sound_db/generate/crumpling_unit.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <functional>
#include <numbers>

#include "sound_db/dsp/filter.h"
#include "sound_db/dsp/level.h"
#include "sound_db/pack/levels.h"

namespace rustle::generate {

namespace {

using std::numbers::pi;

constexpr double kSlope = 1.6;     // amplitude falls as f^-1.6 above the corner
constexpr double kLow_hz = 300.0;  // below, the dipole's two sides cancel: 6 dB per octave
constexpr double kBottom_hz = 60.0, kTop_hz = 18000.0;
constexpr double kSnap_s = 0.001;
constexpr double kAftershocks = 24.0, kEnergyExponent = 1.4;
constexpr double kAfterFrom_s = 0.004, kAfterTo_s = 0.35;
constexpr double kModes_db = -9.0, kBrush_db = -9.0;
constexpr int kParts = 5;
constexpr int kMostModes = 12;
constexpr double kDecayRate = 6.908;  // ln 1000: 60 dB in amplitude
constexpr double kClac_db = -14.0;    // of the reference flap's energy

struct Formant {
  double centre_hz, gain_db, width_octaves;
};

/// How one part of a sheet answers: energy per Hz is shape².
struct Part {
  double corner_hz;
  std::array<Formant, 2> formants;

  double shape(double frequency_hz) const {
    const double low = kLow_hz / frequency_hz, high = frequency_hz / corner_hz;
    double formant_db = 0;
    for (const Formant& f : formants) {
      const double off = std::log2(frequency_hz / f.centre_hz) / f.width_octaves;
      formant_db += f.gain_db * std::exp(-0.5 * off * off);
    }
    return std::pow(10.0, formant_db / 20) / std::sqrt(1 + low * low) * std::pow(1 + high * high, -kSlope / 2);
  }
};

Part random_part(double corner_hz, dsp::Random& random) {
  Part part{corner_hz * std::exp(0.2 * random.normal()), {}};
  for (Formant& f : part.formants) {
    f = {random.log_uniform(0.3, 1.8) * corner_hz, 4.0 * random.normal(), random.uniform(0.25, 0.7)};
  }
  return part;
}

double decay_s(const Paper& paper, double frequency_hz) {
  return std::clamp(2.2 / (paper.loss_factor * frequency_hz), 0.004, 0.8);
}

/// Edges of bands one ERB wide (Glasberg and Moore 1990: 21.4 log10(1 + 0.00437 f)).
std::vector<double> erb_edges_hz(double low_hz, double high_hz) {
  const auto erbs = [](double f) { return 21.4 * std::log10(1 + 0.00437 * f); };
  const auto bands = static_cast<int>(std::ceil(erbs(high_hz) - erbs(low_hz)));
  std::vector<double> edges_hz;
  for (int i = 0; i <= bands; ++i) {
    const double e = erbs(low_hz) + (erbs(high_hz) - erbs(low_hz)) * i / bands;
    edges_hz.push_back((std::pow(10.0, e / 21.4) - 1) / 0.00437);
  }
  return edges_hz;
}

/// Gaussian noise between two frequencies with amplitude density shape(f) relative to white noise of unit variance, in the
/// transform's time buffer.
template <class Shape>
std::span<const float> band_noise(dsp::RealFft& fft, double low_hz, double high_hz, double rate_hz, const Shape& shape,
                                  dsp::Random& random) {
  const double bin_hz = rate_hz / fft.size(), scale = std::sqrt(fft.size() / 2.0);
  const auto spectrum = fft.spectrum();
  std::fill(spectrum.begin(), spectrum.end(), 0.0f);
  const int first = std::max(1, static_cast<int>(std::ceil(low_hz / bin_hz)));
  const int end = std::min(fft.size() / 2, static_cast<int>(std::ceil(high_hz / bin_hz)));
  for (int k = first; k < end; ++k) {
    const double amplitude = scale * shape(k * bin_hz);
    const double real = random.normal(), imaginary = random.normal();
    spectrum[k] = {static_cast<float>(amplitude * real), static_cast<float>(amplitude * imaginary)};
  }
  fft.inverse();
  return fft.time();
}

std::vector<float> part_response(const Part& part, const Paper& paper, std::size_t length, double rate_hz,
                                 dsp::Random& random, Workspace& workspace) {
  std::vector<float> response(length, 0.0f);
  const double top_hz = std::min(kTop_hz, 0.45 * rate_hz);
  const auto edges_hz = erb_edges_hz(kBottom_hz, top_hz);
  for (std::size_t band = 0; band + 1 < edges_hz.size(); ++band) {
    const double low_hz = edges_hz[band], high_hz = edges_hz[band + 1];
    const double t60_s = decay_s(paper, std::sqrt(low_hz * high_hz));
    const auto needed = std::min(length, static_cast<std::size_t>(1.3 * t60_s * rate_hz) + 1);
    // At least eight bins in the band, so that a block of it is noise and not a tone.
    const auto resolved = static_cast<std::size_t>(8 * rate_hz / (high_hz - low_hz));
    auto& fft = workspace.fft(static_cast<int>(std::bit_ceil(std::max(needed, resolved))));
    const auto noise = band_noise(
        fft, low_hz, high_hz, rate_hz, [&](double f) { return part.shape(f); }, random);
    const double decay = std::exp(-kDecayRate / (t60_s * rate_hz));
    double gain = 1 / std::sqrt(t60_s);
    for (std::size_t n = 0; n < needed; ++n, gain *= decay) response[n] += static_cast<float>(gain * noise[n]);
  }
  return response;
}

double energy(std::span<const float> signal) {
  double sum = 0;
  for (const float x : signal) sum += static_cast<double>(x) * x;
  return sum;
}

/// Adds `layer`, scaled to `level_db` below the energy of what is there.
void add_layer(std::vector<float>& out, std::vector<float>& layer, double of_energy, double level_db) {
  const double there = energy(layer);
  if (there <= 0) return;
  const auto gain = static_cast<float>(dsp::db_to_gain(level_db) * std::sqrt(of_energy / there));
  for (std::size_t n = 0; n < out.size(); ++n) out[n] += gain * layer[n];
}

void fade_out(std::span<float> signal, double seconds, double rate_hz) {
  const auto length = std::min(signal.size(), static_cast<std::size_t>(seconds * rate_hz));
  for (std::size_t n = 0; n < length; ++n) {
    signal[signal.size() - length + n] *= static_cast<float>(0.5 * (1 + std::cos(pi * static_cast<double>(n + 1) / length)));
  }
}

std::vector<float> lowest_modes(const Paper& paper, const pack::GridPoint& point, std::size_t length, double rate_hz,
                                dsp::Random& random) {
  std::vector<float> out(length, 0.0f);
  int taken = 0;
  for (const double mode :
       strip_modes_hz(paper, point.ruling_length_m, point.free_border_length_m / 2, kFlapCompression, 400)) {
    if (mode <= 40) continue;
    if (taken++ == kMostModes) break;
    const double phase = 2 * pi * random.uniform(), t60_s = decay_s(paper, mode);
    for (std::size_t n = 0; n < length; ++n) {
      const double t = static_cast<double>(n) / rate_hz;
      const double attack = std::min(1.0, t / 0.003);
      out[n] +=
          static_cast<float>(mode / 100 * attack * std::sin(2 * pi * mode * t + phase) * std::exp(-kDecayRate * t / t60_s));
    }
  }
  return out;
}

/// The sheet brushing air and fingers: noise under a slow random gain, dying away within `spread_s`.
std::vector<float> brush(const Part& part, double spread_s, std::size_t length, double rate_hz, dsp::Random& random,
                         Workspace& workspace) {
  auto& fft = workspace.fft(static_cast<int>(std::bit_ceil(length)));
  const auto noise = band_noise(
      fft, kBottom_hz, std::min(kTop_hz, 0.45 * rate_hz), rate_hz, [&](double f) { return part.shape(f); }, random);
  std::vector<float> out(length);
  // Two equal one-pole low-passes at 60 Hz, scaled to unit variance.
  const double a = std::exp(-2 * pi * 60 / rate_hz), keep = 1 - a;
  const double deviation = std::sqrt(std::pow(keep, 4) * (1 + a * a) / std::pow(1 - a * a, 3));
  double first = 0, second = 0;
  const auto step = [&] {
    first = a * first + keep * random.normal();
    second = a * second + keep * first;
  };
  for (int i = 0; i < static_cast<int>(8 / keep); ++i) step();
  for (std::size_t n = 0; n < length; ++n) {
    step();
    const double t = static_cast<double>(n) / rate_hz;
    const double gain = std::min(1.0, t / 0.01) * std::exp(-t / (0.35 * spread_s)) * std::exp(0.35 * second / deviation);
    out[n] = static_cast<float>(gain * noise[n]);
  }
  return out;
}

}  // namespace

dsp::RealFft& Workspace::fft(int size) {
  return ffts_.try_emplace(size, size).first->second;
}

double flap_corner_hz(const Paper& paper, const pack::GridPoint& point) {
  return paper.brightness * 5200.0 * std::pow(point.ruling_length_m / 0.1, -0.4) *
         std::pow(point.free_border_length_m / 0.2, -0.33);
}

std::vector<float> flap(const Paper& paper, const pack::GridPoint& point, double rate_hz, dsp::Random random,
                        Workspace& workspace) {
  const double corner_hz = flap_corner_hz(paper, point);
  const double size = point.disc_radius_m() / pack::kReferencePoint.disc_radius_m();
  const double ring_s = std::clamp(2.2 / (paper.loss_factor * 0.08 * corner_hz), 0.12, 0.8);
  const double spread_s = kAfterTo_s * std::clamp(size, 0.5, 1.5);
  const auto length = static_cast<std::size_t>(std::clamp(spread_s + 0.6 * ring_s, 0.2, 0.8) * rate_hz);

  struct Shock {
    double time_s, energy;
  };
  const int count = std::max(12, static_cast<int>(kAftershocks * size));
  std::vector<Shock> after;
  double after_energy = 0;
  for (int i = 0; i < count; ++i) {
    after.push_back({random.log_uniform(kAfterFrom_s, spread_s), random.truncated_pareto(kEnergyExponent, 1e-4, 1.0)});
    after_energy += after.back().energy;
  }

  std::array<std::vector<float>, kParts> responses;
  for (auto& response : responses) {
    response = part_response(random_part(corner_hz, random), paper, length, rate_hz, random, workspace);
  }
  std::vector<float> out(length, 0.0f);
  const auto strike = [&](double time_s, double amplitude) {
    const auto& response = responses[random.index(kParts)];
    const auto gain = static_cast<float>(random.index(2) ? amplitude : -amplitude);
    const auto start = std::min(length, static_cast<std::size_t>((kSnap_s + time_s) * rate_hz));
    for (std::size_t n = start; n < length; ++n) out[n] += gain * response[n - start];
  };
  strike(0, 1);
  for (const Shock& shock : after) strike(shock.time_s, std::sqrt(shock.energy / after_energy));

  const double struck = energy(out);
  auto modes = lowest_modes(paper, point, length, rate_hz, random);
  auto moving = brush(random_part(corner_hz, random), spread_s, length, rate_hz, random, workspace);
  add_layer(out, modes, struck, kModes_db);
  add_layer(out, moving, struck, kBrush_db);

  fade_out(out, 0.03, rate_hz);
  const auto rise = static_cast<std::size_t>(kSnap_s * rate_hz);
  for (std::size_t n = 0; n < rise; ++n) out[n] *= static_cast<float>(n) / static_cast<float>(rise);
  const auto gain = static_cast<float>(std::sqrt(size * rate_hz / energy(out)));
  for (float& x : out) x *= gain;
  return out;
}

std::vector<float> clac(const Paper& paper, double rate_hz, dsp::Random random) {
  const auto length = static_cast<std::size_t>(0.03 * rate_hz);
  std::vector<float> out(length, 0.0f), burst(length);
  const auto facets = 1 + random.index(4);
  for (std::uint32_t k = 0; k < facets; ++k) {
    const double facet_m = random.log_uniform(0.005, 0.025);
    const double centre_hz = std::min(paper.brightness * 8000.0 * std::pow(facet_m / 0.005, -0.86), 0.3 * rate_hz);
    const double t60_s = std::clamp(2.2 / (paper.loss_factor * centre_hz), 0.003, 0.018);
    const double start_s = k == 0 ? 0.0003 : random.uniform(0.0005, 0.005);
    const double strength = k == 0 ? 1.0 : random.truncated_pareto(kEnergyExponent, 0.05, 1.0);
    const double width = random.uniform(0.25, 0.95);  // octaves to either side
    const auto band = dsp::butterworth_bandpass(centre_hz * std::pow(2.0, -width),
                                                std::min(centre_hz * std::pow(2.0, width), 0.45 * rate_hz), rate_hz);
    for (float& x : burst) x = static_cast<float>(random.normal());
    dsp::CascadeState state;
    dsp::filter(band, state, burst);
    const double level = std::sqrt(strength / t60_s) / dsp::rms(burst);
    for (std::size_t n = 0; n < length; ++n) {
      const double t = static_cast<double>(n) / rate_hz - start_s;
      if (t < 0) continue;
      out[n] += static_cast<float>(level * std::min(1.0, t / 0.0002) * std::exp(-kDecayRate * t / t60_s) * burst[n]);
    }
  }
  fade_out(out, 0.005, rate_hz);
  const auto gain = static_cast<float>(dsp::db_to_gain(kClac_db) * std::sqrt(rate_hz / energy(out)));
  for (float& x : out) x *= gain;
  return out;
}

}  // namespace rustle::generate
