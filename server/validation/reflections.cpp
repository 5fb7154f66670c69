#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>

#include "server/validation/groups.h"
#include "server/validation/measures.h"
#include "server/validation/virtual_sheet.h"
#include "sound_db/dsp/fft.h"
#include "sound_db/pack/bent_strip.h"
#include "sound_db/pack/emission.h"

namespace rustle::validation {
namespace {

constexpr double kRubbed_s = 40;
constexpr double kBentEdge_m = 0.210, kStraightEdge_m = 0.297;
constexpr std::array<double, 2> kCompressions = {0.30, 0.10};
constexpr std::array<double, 3> kWallDistances_m = {0.10, 0.20, 0.40};
constexpr double kSpeedOfSound_m_per_s = 343.0;
constexpr int kFrames_per_s = 240;

struct OnTable {
  std::vector<float> spectrum;             ///< heard over the reflecting table
  std::vector<report::Point> measured_db;  ///< over the same sheet without reflection, by third octaves
  std::vector<report::Point> expected_db;  ///< eq. 6 by the bent strip's own height and spread
  double worst_db = 0;
};

std::vector<float> slid(const Setting& setting, double compression, bool reflecting) {
  const auto sheet = make_rubbed({kBentEdge_m, kStraightEdge_m, compression, 1333}, kRubbed_s);
  Take take;
  take.sheet = sheet.get();
  take.obstacles = {table(reflecting)};
  take.seed = setting.seed;
  return play(setting, take).samples;
}

OnTable on_table(double compression, const std::vector<float>& with, const std::vector<float>& without) {
  constexpr int kSize = 4096;
  OnTable result;
  result.spectrum = spectrum_of(with);
  const auto a = power_density(std::span(with).subspan(12000), kSize);
  const auto b = power_density(std::span(without).subspan(12000), kSize);
  const auto strip = pack::bent_strip(kBentEdge_m, compression);
  const pack::DipoleOverPlane dipole{strip.mean_height_m, strip.height_spread_m, 1.0, 30.0};
  const double up_m = 0.5 - strip.mean_height_m, along_m = std::cos(std::numbers::pi / 6);
  const double direct = up_m / (up_m * up_m + along_m * along_m);
  for (double centre = 400; centre < 15000; centre *= std::cbrt(2.0)) {
    const double low = centre * std::pow(2, -1.0 / 6), high = centre * std::pow(2, 1.0 / 6);
    double expected = 0;
    constexpr int kParts = 24;
    for (int k = 0; k < kParts; ++k) {
      expected += std::pow(pack::transfer_magnitude(dipole, low + (high - low) * (k + 0.5) / kParts) / direct, 2) / kParts;
    }
    const double measured_db = 10 * std::log10(band_power(a, low, high) / band_power(b, low, high));
    result.measured_db.push_back({centre, measured_db});
    result.expected_db.push_back({centre, 10 * std::log10(expected)});
    result.worst_db = std::max(result.worst_db, std::abs(measured_db - result.expected_db.back().y));
  }
  return result;
}

struct Comb {
  double delay_s = 0;                   ///< by the geometry
  std::vector<report::Point> ratio_db;  ///< with the wall over without
  std::vector<double> notches_hz;
  double worst_share = 0;  ///< greatest |f - k/Δt| Δt / k
};

/// A sheet that turns over between a wall at x = -distance and the listener. Sheet and listener face the wall, so the image
/// is heard from behind: with delay Δt it cancels at k/Δt.
Comb comb(const Setting& setting, double distance_m) {
  constexpr int kSize = 65536;
  constexpr double kTop_hz = 6000;
  constexpr double kReversal_s = 0.02;  // quick, so that most is heard of the sheet at rest
  FlappedSheet flap;
  flap.tilt_rad = std::numbers::pi / 2;
  flap.reversal_s = kReversal_s;
  const auto sheet = make_flapped(flap);
  Take take;
  take.sheet = sheet.get();
  take.listener_m = {std::cos(std::numbers::pi / 6), 0, 0.5};
  take.frame_rate_hz = kFrames_per_s;
  take.seed = setting.seed;
  const Heard without = play(setting, take);
  take.obstacles = {wall({-distance_m, 0, 0}, sheet::Vec3d::UnitX())};
  const Heard with = play(setting, take);

  // Where the sheet comes to rest.
  const auto events = with.crumpling();
  sheet::Vec3d centre_m = sheet::Vec3d::Zero();
  if (!events.empty()) {
    std::vector<float> xyz(3 * sheet->mesh().material_coordinates.size());
    sheet->positions(events.front().confirmed_s + kReversal_s, xyz);
    for (std::size_t v = 0; v < xyz.size(); v += 3) centre_m += sheet::Vec3d(xyz[v], xyz[v + 1], xyz[v + 2]);
    centre_m /= static_cast<double>(xyz.size()) / 3;
  }
  const sheet::Vec3d image_m(-2 * distance_m - centre_m.x(), centre_m.y(), centre_m.z());
  Comb result;
  result.delay_s = ((take.listener_m - image_m).norm() - (take.listener_m - centre_m).norm()) / kSpeedOfSound_m_per_s;

  // The transfer by the wall: cross-spectrum over power, both over the whole sound, averaged over neighbouring bins.
  dsp::RealFft first(kSize), second(kSize);
  const auto fill = [&](dsp::RealFft& fft, const Heard& heard) {
    for (std::size_t n = 0; n < kSize; ++n) fft.time()[n] = n < heard.samples.size() ? heard.samples[n] : 0.0F;
    fft.forward();
  };
  fill(first, without);
  fill(second, with);
  const double bin_hz = static_cast<double>(kRate_hz) / kSize;
  const double width_hz = 0.06 / result.delay_s;
  const auto half = std::max<std::ptrdiff_t>(2, std::lround(width_hz / bin_hz / 2));
  std::vector<double> gain;
  const auto bins = static_cast<std::ptrdiff_t>(kTop_hz / bin_hz);
  for (std::ptrdiff_t k = 0; k < bins; ++k) {
    double power = 0, reference = 0;
    for (std::ptrdiff_t j = std::max<std::ptrdiff_t>(0, k - half); j <= k + half; ++j) {
      power += std::norm(second.spectrum()[static_cast<std::size_t>(j)]);
      reference += std::norm(first.spectrum()[static_cast<std::size_t>(j)]);
    }
    gain.push_back(power / std::max(reference, 1e-30));
    if (k % 8 == 0) result.ratio_db.push_back({static_cast<double>(k) * bin_hz, 10 * std::log10(gain.back() + 1e-9)});
  }
  for (int n = 1; (n + 0.5) / result.delay_s < kTop_hz; ++n) {
    // The centre of what is missing in the dip between two neighbouring peaks' places.
    const auto from = static_cast<std::ptrdiff_t>((n - 0.5) / result.delay_s / bin_hz);
    const auto to = static_cast<std::ptrdiff_t>((n + 0.5) / result.delay_s / bin_hz);
    const auto least = std::min_element(gain.begin() + from, gain.begin() + to) - gain.begin();
    const double notch_hz = static_cast<double>(least) * bin_hz;
    result.notches_hz.push_back(notch_hz);
    result.worst_share = std::max(result.worst_share, std::abs(notch_hz * result.delay_s / n - 1));
  }
  if (events.empty() || result.notches_hz.empty()) result.worst_share = std::nan("");
  return result;
}

}  // namespace

Findings reflections(const Setting& setting) {
  std::array<std::array<std::vector<float>, 2>, kCompressions.size()> heard;
  std::array<Comb, kWallDistances_m.size()> combs;
  run_all(setting, 2 * heard.size() + combs.size(), [&](std::size_t k) {
    if (k < 2 * heard.size()) {
      heard[k / 2][k % 2] = slid(setting, kCompressions[k / 2], k % 2 == 0);
    } else {
      combs[k - 2 * heard.size()] = comb(setting, kWallDistances_m[k - 2 * heard.size()]);
    }
  });
  Findings found;
  report::Plot plot;
  plot.x = {"frequency (Hz)", true, 350, 16000, {}};
  plot.y = {"level over no reflection (dB)", false, 0, 0, {}};
  std::vector<OnTable> tables;
  for (std::size_t k = 0; k < heard.size(); ++k) {
    tables.push_back(on_table(kCompressions[k], heard[k][0], heard[k][1]));
    const int percent = static_cast<int>(std::lround(100 * kCompressions[k]));
    found.checks.push_back({fmt::format("reflections/table_{}", percent), tables.back().worst_db, std::nullopt,
                            at_most(1, "dB"), "dB",
                            fmt::format("A4 sheet compressed by {} %, table on over off: greatest difference from eq. 6 for "
                                        "the strip's height and spread, third octaves from 400 Hz",
                                        percent)});
    const report::Colour colour = report::series_colour(static_cast<int>(k));
    plot.series.push_back({fmt::format("{} %", percent), tables.back().measured_db, colour});
    plot.series.push_back(
        {fmt::format("{} %, eq. 6", percent), tables.back().expected_db, colour, report::PlotSeries::Style::kDashed});
  }
  const double high_hz = centroid_hz(tables[1].spectrum), low_hz = centroid_hz(tables[0].spectrum);
  found.checks.push_back(
      {"reflections/pitch_by_height", 100 * (high_hz / low_hz - 1), std::nullopt, at_least(1, "%"), "%",
       fmt::format("the sheet that stands lower sounds higher: centroid at 10 % over 30 %, {:.0f} to {:.0f} Hz", low_hz,
                   high_hz)});
  found.figures.push_back(
      {"Figure 14: friction above a table",
       "An A4 sheet compressed by 30 % and by 10 %, 1 m away and 30 degrees up: what the table's reflection "
       "adds, as rendered and by eq. 6 for an extended source.",
       plot});

  report::Plot notches;
  notches.x = {"frequency (Hz)", false, 0, 6000, {}};
  notches.y = {"level over no wall (dB)", false, -30, 8, {}};
  double worst_percent = 0;
  for (std::size_t k = 0; k < combs.size(); ++k) {
    worst_percent = std::max(worst_percent, std::isnan(combs[k].worst_share) ? 1e9 : 100 * combs[k].worst_share);
    const report::Colour colour = report::series_colour(static_cast<int>(k));
    notches.series.push_back({fmt::format("wall {:.0f} cm behind", 100 * kWallDistances_m[k]), combs[k].ratio_db, colour});
    report::PlotSeries marks{"", {}, colour, report::PlotSeries::Style::kRings};
    for (std::size_t n = 0; n < combs[k].notches_hz.size(); ++n) {
      marks.points.push_back({static_cast<double>(n + 1) / combs[k].delay_s, -27.0 + 2 * static_cast<double>(k)});
    }
    notches.series.push_back(std::move(marks));
  }
  found.checks.push_back({"reflections/wall_comb", worst_percent, std::nullopt, at_most(2, "%"), "%",
                          "greatest distance of a notch of a flap near a wall from the geometry's"});
  found.figures.push_back(
      {"Figure 15: the comb of a wall",
       "A 10 x 10 cm sheet turns over before a wall; the rings at the bottom are the geometry's notches.", notches});
  return found;
}

}  // namespace rustle::validation
