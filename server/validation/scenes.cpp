#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "client_sdk/sheets/demos.h"
#include "client_sdk/sheets/shape.h"
#include "server/validation/groups.h"
#include "server/validation/measures.h"
#include "server/validation/virtual_sheet.h"
#include "sound_db/dsp/level.h"

namespace rustle::validation {
namespace {

constexpr double kFigure1_s = 5.2;
constexpr double kBowing_s = 6, kLeastBow = 0.02, kMostBow = 0.35;
constexpr double kBowWindow_s = 0.5;
constexpr double kShakes_per_s = 2.5;  // of the demo

/// The back edge of an A4 sheet is held while the front edge slides toward it at an even pace, from nearly flat on.
std::unique_ptr<sheets::AnimatedSheet> make_bowing() {
  sheets::Animation animation;
  animation.duration_s = kBowing_s;
  animation.on_table = true;
  constexpr double kLength_m = 0.297, kWidth_m = 0.210;
  animation.map_at = [](double time_s) -> sheets::MaterialMap {
    const double compression = kLeastBow + (kMostBow - kLeastBow) * std::clamp(time_s / kBowing_s, 0.0, 1.0);
    const sheets::BentShape shape(kLength_m, kWidth_m, 0, {},
                                  {1 / sheets::radius_from_compression_m(kLength_m, compression)});
    const sheets::Point3 back = shape.at(0, 0);
    return [shape, back](double u, double v) -> sheets::Point3 {
      const sheets::Point3 p = shape.at(u, v);
      return {p[0] - back[0] - 0.15, p[1], p[2] - back[2]};
    };
  };
  animation.is_held = [](double, double u, double) { return u < 1e-6; };
  return sheets::make_animated(sheets::make_rectangle(sheets::MeshKind::kDelaunay, kLength_m, kWidth_m, 1333, 1),
                               std::move(animation));
}

/// A flat A4 sheet in the air with a dent of 4 cm in its middle that snaps through once: no free border bends.
constexpr double kDentSnap_s = 0.5;
std::unique_ptr<sheets::AnimatedSheet> make_dented() {
  sheets::Animation animation;
  animation.duration_s = 1.0;
  animation.map_at = [](double time_s) -> sheets::MaterialMap {
    const double depth_m = 0.003 * (1 - 2 * sheets::smooth_step((time_s - kDentSnap_s + 0.01) / 0.02));
    return [depth_m](double u, double v) -> sheets::Point3 {
      const double x = u - 0.1485, y = v - 0.105;
      const double share = (x * x + y * y) / (0.04 * 0.04);
      const double dent = share < 1 ? (1 - share) * (1 - share) * (1 - share) : 0;
      return {x, y, depth_m * dent};
    };
  };
  return sheets::make_animated(sheets::make_rectangle(sheets::MeshKind::kDelaunay, 0.297, 0.210, 2000, 1),
                               std::move(animation));
}

/// Period of the sound's bursts: the lag between 0.15 and 0.65 s at which its envelope is most like itself.
double burst_period_s(std::span<const float> samples) {
  constexpr std::size_t kPerSecond = 200, kWindow = kRate_hz / kPerSecond;
  std::vector<double> level;
  for (std::size_t from = 0; from + kWindow <= samples.size(); from += kWindow) {
    level.push_back(std::sqrt(dsp::rms(samples.subspan(from, kWindow))));
  }
  double mean = 0;
  for (const double x : level) mean += x / static_cast<double>(level.size());
  double best = -kUnbounded, best_s = 0;
  for (std::size_t lag = kPerSecond * 15 / 100; lag < kPerSecond * 65 / 100; ++lag) {
    double alike = 0;
    for (std::size_t n = 0; n + lag < level.size(); ++n) alike += (level[n] - mean) * (level[n + lag] - mean);
    alike /= static_cast<double>(level.size() - lag);
    if (alike <= best) continue;
    best = alike;
    best_s = static_cast<double>(lag) / kPerSecond;
  }
  return best_s;
}

/// Spread of third-octave densities in dB (standard deviation) between two frequencies: 0 for white noise.
double spread_db(std::span<const float> samples, double from_hz, double to_hz) {
  const auto density = power_density(samples, 4096);
  std::vector<double> db;
  for (double centre = from_hz; centre <= to_hz; centre *= std::cbrt(2.0)) {
    const double low = centre * std::pow(2, -1.0 / 6), high = centre * std::pow(2, 1.0 / 6);
    db.push_back(10 * std::log10(band_power(density, low, high) / (high - low)));
  }
  double mean = 0, square = 0;
  for (const double x : db) mean += x / static_cast<double>(db.size());
  for (const double x : db) square += (x - mean) * (x - mean) / static_cast<double>(db.size());
  return std::sqrt(square);
}

Take take_of(const sheets::AnimatedSheet& sheet, std::uint64_t seed, bool on_table) {
  Take take;
  take.sheet = &sheet;
  if (on_table) take.obstacles = {table()};
  take.seed = seed;
  return take;
}

enum Scene : std::size_t { kWhole, kBow, kFlat, kBent, kClac, kClacPrinted, kFlap, kShake, kScenes };

}  // namespace

Findings scenes(const Setting& setting) {
  std::array<Heard, kScenes> heard;
  run_all(setting, kScenes, [&](std::size_t k) {
    std::unique_ptr<sheets::AnimatedSheet> sheet;
    Take take;
    switch (k) {
      case kWhole:
        sheet = sheets::make_demo("bend_slide_snap_shake", 1333);
        take = take_of(*sheet, setting.seed, true);
        break;
      case kBow:
        sheet = make_bowing();
        take = take_of(*sheet, setting.seed, true);
        break;
      case kFlat:
      case kBent:
        sheet = make_rubbed({0.210, 0.297, k == kFlat ? 0.0 : 0.30, 1333}, 6);
        take = take_of(*sheet, setting.seed, true);
        break;
      case kClac:
      case kClacPrinted:
        sheet = make_dented();
        take = take_of(*sheet, setting.seed, false);
        take.frame_rate_hz = 120;
        if (k == kClacPrinted) take.mode = engine::Mode::kPublished;
        break;
      case kFlap:
        sheet = make_flapped({});
        take = take_of(*sheet, setting.seed, false);
        take.frame_rate_hz = 120;
        break;
      default:
        sheet = sheets::make_demo("shake", 1333);
        take = take_of(*sheet, setting.seed, false);
        take.listener_m = listening_point_m() + sheet::Vec3d(0.15, 0, 0.4);
    }
    heard[k] = play(setting, take);
  });

  Findings found;
  // Fig. 1: the band moves with the bending.
  std::vector<double> bows, centroids_hz;
  report::PlotSeries centres{"centroid of half a second", {}, report::Ink::kFriction, report::PlotSeries::Style::kDots};
  for (double t = 0.25; t + kBowWindow_s < kBowing_s - 0.1; t += kBowWindow_s) {
    bows.push_back(kLeastBow + (kMostBow - kLeastBow) * (t + kBowWindow_s / 2) / kBowing_s);
    centroids_hz.push_back(centroid_hz(spectrum_of(heard[kBow].between(t, t + kBowWindow_s), 0)));
    centres.points.push_back({100 * bows.back(), centroids_hz.back()});
  }
  found.checks.push_back(
      {"scenes/band_follows_bending", rank_correlation(bows, centroids_hz), std::nullopt, at_most(-0.9), "",
       "Fig. 1: rank correlation between how much an A4 sheet is bowed and the centroid of its friction; -1: the "
       "more bent, the lower, throughout"});
  const double flat_db = dsp::rms_dbfs(heard[kFlat].between(0.5, 5.5)),
               bent_db = dsp::rms_dbfs(heard[kBent].between(0.5, 5.5));
  found.checks.push_back({"scenes/flat_quieter", bent_db - flat_db, std::nullopt, at_least(3, "dB"), "dB",
                          "Fig. 3: a bent A4 sheet over a flat one, both slid at 0.1 m/s"});
  found.checks.push_back({"scenes/flat_near_white", spread_db(heard[kFlat].between(0.5, 5.5), 1000, 10000), std::nullopt,
                          at_most(3, "dB"), "dB",
                          "Fig. 3: spread of the flat sheet's third octaves from 1 to 10 kHz; white noise: 0"});
  const auto clac = heard[kClacPrinted].between(kDentSnap_s - 0.05, kDentSnap_s + 0.45);
  const auto flap = heard[kFlap].between(0.25, 1.2);
  found.checks.push_back(
      {"scenes/clac_t60", 1000 * t60_s(clac), std::nullopt, at_most(20, "ms"), "ms",
       "Fig. 4: T60 of a clac by itself, rendered as printed, so without the finer events that go on after it"});
  found.checks.push_back({"scenes/flap_decay", 1000 * last_within_30_db_s(flap), std::nullopt, between(80, 600, "ms"), "ms",
                          "Fig. 4: the same of a flap; a few hundred milliseconds"});
  const double period_s = burst_period_s(heard[kShake].between(0.6, 3.4));
  found.checks.push_back({"scenes/shake_period", 1000 * period_s, std::nullopt, around(1000 / kShakes_per_s, 20, "ms"), "ms",
                          "Fig. 17: lag at which the sound of a sheet shaken 2.5 times a second is most like itself"});

  const auto picture = [](std::string title, std::vector<float> samples) {
    Picture one;
    one.title = std::move(title);
    one.samples = std::move(samples);
    return one;
  };
  found.figures.push_back({"Figure 1: bent, slid, released",
                           "One continuous motion: an A4 sheet lies flat, its front edge slides toward the held back edge "
                           "(0.3 to 1.7 s), it is slid "
                           "(1.9 to 3.0 s), the back edge is released and stands up (3.2 s).",
                           Pictures{{picture("whole motion", heard[kWhole].between(0, kFigure1_s))}}});
  report::Plot band;
  band.x = {"compression (%)", false, 0, 0, {}};
  band.y = {"centroid (Hz)", false, 0, 0, {}};
  band.series = {centres};
  found.figures.push_back({"Figure 1: the band moves with the bending",
                           "The front edge of an A4 sheet slides toward its held back edge at an even pace.", band});
  found.figures.push_back(
      {"Figure 3: friction, flat and bent", "An A4 sheet slid over a table at 0.1 m/s, flat and bent by 30 %.",
       Pictures{{picture("flat", heard[kFlat].between(0.5, 2.5)), picture("bent", heard[kBent].between(0.5, 2.5))}}});
  found.figures.push_back({"Figure 4: clac and flap",
                           "A dent in the middle of a flat sheet snaps through; a whole 10 x 10 cm sheet turns over.",
                           Pictures{{picture("clac", heard[kClacPrinted].between(0.4, 1.0)),
                                     picture("clac and finer events", heard[kClac].between(0.4, 1.0)),
                                     picture("flap", heard[kFlap].between(0.2, 0.8))}}});
  found.figures.push_back({"Figure 17: an A4 sheet lightly shaken",
                           "Held along one border and wiggled 2.5 times a second; 1.5 s.",
                           Pictures{{picture("shaken", heard[kShake].between(1.0, 2.5))}}});
  return found;
}

}  // namespace rustle::validation
