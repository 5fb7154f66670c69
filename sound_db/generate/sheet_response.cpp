#include "sound_db/generate/sheet_response.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace rustle::generate {

namespace {

constexpr double kDecayRate = 6.907755;  // ln 1000: 60 dB in amplitude
constexpr double kTopOfRate = 0.47;

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

/// Noise between two frequencies, relative to white noise of unit variance, in the transform's time buffer.
std::span<const float> band_noise(dsp::RealFft& fft, double low_hz, double high_hz, double rate_hz, const Response& response,
                                  dsp::Random& random) {
  const double bin_hz = rate_hz / fft.size(), scale = std::sqrt(fft.size() / 2.0);
  const auto spectrum = fft.spectrum();
  std::fill(spectrum.begin(), spectrum.end(), 0.0f);
  const int first = std::max(1, static_cast<int>(std::ceil(low_hz / bin_hz)));
  const int end = std::min(fft.size() / 2, static_cast<int>(std::ceil(high_hz / bin_hz)));
  for (int k = first; k < end; ++k) {
    const double amplitude = scale * response.shape(k * bin_hz);
    const double real = random.normal(), imaginary = random.normal();
    spectrum[k] = {static_cast<float>(amplitude * real), static_cast<float>(amplitude * imaginary)};
  }
  fft.inverse();
  return fft.time();
}

}  // namespace

dsp::RealFft& Workspace::fft(int size) {
  return ffts_.try_emplace(size, size).first->second;
}

double Response::shape(double frequency_hz) const {
  const double low = low_hz / frequency_hz, high = frequency_hz / corner_hz;
  double formant_db = 0;
  for (const Formant& f : formants) {
    const double off = std::log2(frequency_hz / f.centre_hz) / f.width_octaves;
    formant_db += f.gain_db * std::exp(-0.5 * off * off);
  }
  return std::pow(10.0, formant_db / 20) * std::pow(1 + low * low, -low_order / 2) * std::pow(1 + high * high, -slope / 2);
}

std::vector<float> blow(const Response& response, const Paper& paper, const Ringing& ringing, std::size_t length,
                        double rate_hz, dsp::Random& random, Workspace& workspace) {
  std::vector<float> out(length, 0.0f);
  const auto edges_hz = erb_edges_hz(ringing.from_hz, kTopOfRate * rate_hz);
  for (std::size_t band = 0; band + 1 < edges_hz.size(); ++band) {
    const double low_hz = edges_hz[band], high_hz = edges_hz[band + 1];
    const double t60_s = ringing.damping * std::min(ringing.longest_s, decay_s(paper, std::sqrt(low_hz * high_hz)));
    const auto needed = std::min(length, static_cast<std::size_t>(1.3 * t60_s * rate_hz) + 1);
    // At least eight bins in the band, so that a block of it is noise and not a tone.
    const auto resolved = static_cast<std::size_t>(8 * rate_hz / (high_hz - low_hz));
    auto& fft = workspace.fft(static_cast<int>(std::bit_ceil(std::max(needed, resolved))));
    const auto noise = band_noise(fft, low_hz, high_hz, rate_hz, response, random);
    const double decay = std::exp(-kDecayRate / (t60_s * rate_hz));
    double gain = 1 / std::sqrt(t60_s);
    for (std::size_t n = 0; n < needed; ++n, gain *= decay) out[n] += static_cast<float>(gain * noise[n]);
  }
  return out;
}

std::vector<float> shaped_noise(const Response& response, double from_hz, std::size_t length, double rate_hz,
                                dsp::Random& random, Workspace& workspace) {
  auto& fft = workspace.fft(static_cast<int>(std::bit_ceil(length)));
  const auto noise = band_noise(fft, from_hz, kTopOfRate * rate_hz, rate_hz, response, random);
  return {noise.begin(), noise.begin() + static_cast<std::ptrdiff_t>(length)};
}

}  // namespace rustle::generate
