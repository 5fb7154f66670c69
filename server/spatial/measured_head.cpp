#include "server/spatial/measured_head.h"

#include <fmt/format.h>
#include <mysofa.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <complex>
#include <memory>
#include <numbers>
#include <vector>

#include "server/spatial/dipole.h"
#include "server/spatial/hrtf_level.h"
#include "sound_db/dsp/fft.h"

namespace rustle::spatial {
namespace {

constexpr unsigned kLongest = 4096;  ///< samples of an impulse response
constexpr int kFiner = 4;            ///< points per sample in which a delay is looked for
constexpr unsigned kLeastFft = 1024;
constexpr std::size_t kLeastDirections = 12;
constexpr double kKernel_rad = 2.0 * std::numbers::pi / 180;
constexpr double kKernelReach = 25;  ///< times its variance, half the squared angle
constexpr double kEqualiserFloor = 0.01;
constexpr double kDelayBand_hz = 10000;  ///< delays are those of sound below
constexpr int kSpherePoints = 8192;

struct Closing {
  void operator()(MYSOFA_HRTF* file) const { mysofa_free(file); }
};
using SofaFile = std::unique_ptr<MYSOFA_HRTF, Closing>;

/// The file's content that counts, in its own rate.
struct Measurements {
  double rate_hz = 0;
  int fft_size = 0;
  std::vector<Vec3> directions;
  std::vector<std::array<std::vector<double>, 2>> magnitudes;  ///< [direction][ear][bins]
  std::vector<std::array<double, 2>> delays_s;                 ///< [direction][ear]
};

std::string_view reason(int code) {
  switch (code) {
    case MYSOFA_READ_ERROR:
      return "it ends early or cannot be read";
    case MYSOFA_INVALID_FORMAT:
    case MYSOFA_UNSUPPORTED_FORMAT:
      return "it is not an HDF5 file of the kind SOFA uses, or it is damaged";
    case MYSOFA_INVALID_DIMENSIONS:
    case MYSOFA_INVALID_DIMENSION_LIST:
      return "its dimensions do not fit together";
    case MYSOFA_ONLY_THE_SAME_SAMPLING_RATE_SUPPORTED:
      return "its measurements differ in sample rate";
    case MYSOFA_RECEIVERS_WITH_RCI_SUPPORTED:
    case MYSOFA_RECEIVERS_WITH_CARTESIAN_SUPPORTED:
    case MYSOFA_INVALID_RECEIVER_POSITIONS:
      return "its receivers are not two ears";
    default:
      return "it is damaged, or it holds something other than head-related impulse responses";
  }
}

/// Minimum phase for a magnitude: fft.size() samples. Oppenheim and Schafer's folded cepstrum.
void minimum_phase(std::span<const double> magnitude, dsp::RealFft& fft, std::span<float> out) {
  const auto spectrum = fft.spectrum();
  const double least = 1e-6 * std::max(1e-12, *std::max_element(magnitude.begin(), magnitude.end()));
  for (std::size_t k = 0; k < spectrum.size(); ++k)
    spectrum[k] = std::log(static_cast<float>(std::max(magnitude[k], least)));
  fft.inverse();
  const auto cepstrum = fft.time();
  const std::size_t half = cepstrum.size() / 2;
  for (std::size_t n = 1; n < half; ++n) cepstrum[n] *= 2;
  std::fill(cepstrum.begin() + static_cast<std::ptrdiff_t>(half) + 1, cepstrum.end(), 0.0F);
  fft.forward();
  for (std::complex<float>& value : fft.spectrum()) value = std::polar(std::exp(value.real()), value.imag());
  fft.inverse();
  std::copy(fft.time().begin(), fft.time().end(), out.begin());
}

/// By how much `response` lags its minimum phase, in samples: where their correlation below kDelayBand_hz is greatest.
double lag(std::span<const std::complex<float>> response, std::span<const std::complex<float>> least, double rate_hz,
           dsp::RealFft& fine) {
  const auto spectrum = fine.spectrum();
  std::fill(spectrum.begin(), spectrum.end(), std::complex<float>(0));
  const auto top =
      std::min(least.size(), static_cast<std::size_t>(kDelayBand_hz / rate_hz * static_cast<double>(fine.size() / kFiner)));
  for (std::size_t k = 1; k < top; ++k) spectrum[k] = response[k] * std::conj(least[k]);
  fine.inverse();
  const auto x = fine.time();
  const auto best = static_cast<std::size_t>(std::max_element(x.begin(), x.end()) - x.begin());
  const double before = x[(best + x.size() - 1) % x.size()], at = x[best], after = x[(best + 1) % x.size()];
  const double bend = before - 2 * at + after;
  const double peak = static_cast<double>(best) + (bend < 0 ? 0.5 * (before - after) / bend : 0);
  const auto whole = static_cast<double>(x.size());
  return (peak > whole / 2 ? peak - whole : peak) / kFiner;
}

tl::expected<Measurements, std::string> read(MYSOFA_HRTF& file) {
  if (const int bad = mysofa_check(&file); bad != MYSOFA_OK) return tl::unexpected(std::string(reason(bad)));
  if (file.R != 2) return tl::unexpected(fmt::format("it has {} receivers instead of two ears", file.R));
  const std::size_t count = file.M, length = file.N;
  if (length < 16 || length > kLongest) {
    return tl::unexpected(fmt::format("its impulse responses have {} samples instead of 16 to {}", length, kLongest));
  }
  if (file.DataIR.elements < count * 2 * length || file.SourcePosition.elements < 3 * count ||
      file.DataSamplingRate.elements < 1) {
    return tl::unexpected(std::string("its dimensions do not fit together"));
  }
  mysofa_tocartesian(&file);
  Measurements out;
  out.rate_hz = file.DataSamplingRate.values[0];
  if (!(out.rate_hz >= 8000 && out.rate_hz <= 384000)) {
    return tl::unexpected(fmt::format("its sample rate is {} Hz instead of 8,000 to 384,000", out.rate_hz));
  }
  const auto position = [&](std::size_t m) {
    const float* p = file.SourcePosition.values + 3 * m;
    return Vec3(p[0], p[1], p[2]);
  };
  double farthest_m = 0;
  for (std::size_t m = 0; m < count; ++m) farthest_m = std::max(farthest_m, norm(position(m)));
  out.fft_size = static_cast<int>(std::bit_ceil(2 * std::max<unsigned>(file.N, kLeastFft / 2)));
  dsp::RealFft fft(out.fft_size), fine(out.fft_size * kFiner);
  const std::size_t bins = fft.spectrum().size();
  std::vector<std::complex<float>> spectrum(bins);
  std::vector<float> least(fft.time().size());
  for (std::size_t m = 0; m < count; ++m) {
    const Vec3 from_m = position(m);
    if (!(norm(from_m) > 0.9 * farthest_m)) continue;
    out.directions.push_back(normalized(from_m, {1, 0, 0}));
    auto& magnitudes = out.magnitudes.emplace_back();
    auto& delays_s = out.delays_s.emplace_back();
    for (std::size_t ear = 0; ear < 2; ++ear) {
      const std::span<const float> response(file.DataIR.values + (2 * m + ear) * length, length);
      if (!std::all_of(response.begin(), response.end(), [](float x) { return std::abs(x) < 1e6F; })) {
        return tl::unexpected(std::string("an impulse response holds something other than numbers of reasonable size"));
      }
      std::fill(fft.time().begin(), fft.time().end(), 0.0F);
      std::copy(response.begin(), response.end(), fft.time().begin());
      fft.forward();
      std::copy(fft.spectrum().begin(), fft.spectrum().end(), spectrum.begin());
      magnitudes[ear].reserve(bins);
      for (const auto& value : spectrum) magnitudes[ear].push_back(std::abs(value));
      minimum_phase(magnitudes[ear], fft, least);
      std::copy(least.begin(), least.end(), fft.time().begin());
      fft.forward();
      const std::size_t delay = file.DataDelay.elements >= 2 * count ? 2 * m + ear : ear;
      const double stated = delay < file.DataDelay.elements ? static_cast<double>(file.DataDelay.values[delay]) : 0.0;
      delays_s[ear] = (lag(spectrum, fft.spectrum(), out.rate_hz, fine) + stated) / out.rate_hz;
    }
  }
  if (out.directions.size() < kLeastDirections) {
    return tl::unexpected(
        fmt::format("it has {} directions; at least {} are needed", out.directions.size(), kLeastDirections));
  }
  return out;
}

/// How much of the sphere each direction stands for: points spread evenly (a Fibonacci spiral), each to its nearest.
std::vector<double> shares_of_sphere(const std::vector<Vec3>& directions) {
  std::vector<double> shares(directions.size());
  for (int k = 0; k < kSpherePoints; ++k) {
    const double z = 1 - (2 * k + 1.0) / kSpherePoints, turn = k * std::numbers::pi * (3 - std::sqrt(5.0));
    const double r = std::sqrt(1 - z * z);
    const Vec3 point{r * std::cos(turn), r * std::sin(turn), z};
    const auto nearest = std::max_element(directions.begin(), directions.end(),
                                          [&](const Vec3& a, const Vec3& b) { return dot(a, point) < dot(b, point); });
    shares[static_cast<std::size_t>(nearest - directions.begin())] += 1.0 / kSpherePoints;
  }
  return shares;
}

void equalise(Measurements& measured) {
  const std::vector<double> shares = shares_of_sphere(measured.directions);
  std::vector<double> mean(measured.magnitudes.front()[0].size());
  for (std::size_t m = 0; m < shares.size(); ++m) {
    for (const auto& ear : measured.magnitudes[m]) {
      for (std::size_t k = 0; k < mean.size(); ++k) mean[k] += 0.5 * shares[m] * ear[k] * ear[k];
    }
  }
  double loudest = 0;
  for (double& x : mean) loudest = std::max(loudest, x = std::sqrt(x));
  for (auto& ears : measured.magnitudes) {
    for (auto& ear : ears) {
      for (std::size_t k = 0; k < mean.size(); ++k) ear[k] /= std::max(mean[k], kEqualiserFloor * loudest);
    }
  }
}

struct Neighbour {
  std::size_t index;
  double share;
};

std::vector<Neighbour> neighbours(const std::vector<Vec3>& directions, const Vec3& wanted) {
  std::vector<double> exponents(directions.size());
  std::transform(directions.begin(), directions.end(), exponents.begin(), [&](const Vec3& direction) {
    const double angle = std::acos(std::clamp(dot(direction, wanted), -1.0, 1.0)) / kKernel_rad;
    return 0.5 * angle * angle;
  });
  const double least = *std::min_element(exponents.begin(), exponents.end());
  std::vector<Neighbour> out;
  double sum = 0;
  for (std::size_t m = 0; m < directions.size(); ++m) {
    if (exponents[m] - least > kKernelReach) continue;
    out.push_back({m, std::exp(least - exponents[m])});
    sum += out.back().share;
  }
  for (Neighbour& neighbour : out) neighbour.share /= sum;
  return out;
}

/// A magnitude of the file's rate at the bins of another one.
void to_rate(std::span<const double> magnitude, double from_hz, double to_hz, std::span<double> out) {
  for (std::size_t k = 0; k < out.size(); ++k) {
    const double bin = std::min(static_cast<double>(k) * to_hz / from_hz, 0.95 * static_cast<double>(magnitude.size() - 1));
    const auto below = static_cast<std::size_t>(bin);
    const double t = bin - static_cast<double>(below);
    out[k] = (1 - t) * magnitude[below] + t * magnitude[below + 1];
  }
}

Hrtf on_grid(Measurements measured, double rate_hz) {
  for (auto& ears : measured.magnitudes) {
    for (auto& ear : ears) {
      for (double& x : ear) x = std::log(std::max(x, 1e-5));
    }
  }
  const auto taps = static_cast<std::size_t>(Hrtf::taps_at(rate_hz));
  dsp::RealFft fft(measured.fft_size);
  std::vector<double> level(fft.spectrum().size()), magnitude(level.size());
  std::vector<float> impulse(fft.time().size());
  std::vector<Hrtf::Response> responses;
  responses.reserve(2 * static_cast<std::size_t>(Hrtf::kDirections));
  for (int index = 0; index < Hrtf::kDirections; ++index) {
    const auto near = neighbours(measured.directions, Hrtf::direction(index));
    for (std::size_t ear = 0; ear < 2; ++ear) {
      Hrtf::Response response;
      std::fill(level.begin(), level.end(), 0.0);
      for (const Neighbour& neighbour : near) {
        const auto& heard = measured.magnitudes[neighbour.index][ear];
        for (std::size_t k = 0; k < level.size(); ++k) level[k] += neighbour.share * heard[k];
        response.delay_s += neighbour.share * measured.delays_s[neighbour.index][ear];
      }
      for (double& x : level) x = std::exp(x);
      to_rate(level, measured.rate_hz, rate_hz, magnitude);
      minimum_phase(magnitude, fft, impulse);
      response.filter.assign(impulse.begin(), impulse.begin() + static_cast<std::ptrdiff_t>(taps));
      for (std::size_t n = 3 * taps / 4; n < taps; ++n) {
        const double left = static_cast<double>(taps - n) / static_cast<double>(taps - 3 * taps / 4 + 1);
        response.filter[n] *= static_cast<float>(0.5 - 0.5 * std::cos(std::numbers::pi * left));
      }
      responses.push_back(std::move(response));
    }
  }
  const std::size_t ahead = static_cast<std::size_t>(Hrtf::kElevations / 2) * Hrtf::kAzimuths;
  const double centre_s = 0.5 * (responses[2 * ahead].delay_s + responses[2 * ahead + 1].delay_s);
  for (Hrtf::Response& response : responses) response.delay_s -= centre_s;
  level_ahead(rate_hz, responses);
  return {rate_hz, responses};
}

}  // namespace

tl::expected<Hrtf, std::string> measured_head(const std::filesystem::path& sofa, double rate_hz) {
  const auto fail = [&](std::string_view why) {
    return tl::unexpected(
        fmt::format("{}: {}; name a SOFA file of the convention SimpleFreeFieldHRIR, or use the HRTF "
                    "\"structural\"",
                    sofa.string(), why));
  };
  std::error_code failed;
  if (!std::filesystem::is_regular_file(sofa, failed)) return fail("there is no such file");
  int code = MYSOFA_OK;
  const SofaFile file(mysofa_load(sofa.c_str(), &code));
  if (!file || code != MYSOFA_OK) return fail(reason(code));
  auto measured = read(*file);
  if (!measured) return fail(measured.error());
  equalise(*measured);
  return on_grid(std::move(*measured), rate_hz);
}

}  // namespace rustle::spatial
