#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "server/synthesis/source_paths.h"
#include "server/synthesis/tear_gate.h"
#include "server/synthesis/tear_noise.h"
#include "server/synthesis/tearing.h"
#include "server/validation/groups.h"
#include "server/validation/measures.h"
#include "server/validation/stage.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/random.h"

namespace rustle::validation {
namespace {

using synthesis::Mode;

constexpr double kFrame_s = 0.1;
constexpr double kLead_s = 0.2;  ///< left out
constexpr std::array<double, 5> kSpeeds_m_per_s = {0.05, 0.1, 0.2, 0.5, 1.0};
constexpr double kSteady_s = 10;
constexpr double kLong_s = 60;  ///< of the printed formula, whose kurtosis comes from rare peaks
constexpr int kBreaks = 20000;
constexpr double kSlow_m_per_s = 0.1, kFast_m_per_s = 1.0;  ///< of Figs. 6 to 8
constexpr double kClip_s = 0.05;

struct Tear {
  std::shared_ptr<const pack::SoundPack> pack;
  double speed_m_per_s = 0.1;
  double seconds = kSteady_s;
  Mode mode = Mode::kCorrected;
  pack::GridPoint cone = kStagePoint;
  std::uint64_t seed = 1;
};

/// A tear at an even speed, heard at 1 m on the axis of the cone at its tip; its beginning is left out.
std::vector<float> torn(const Tear& tear) {
  Stage stage(tear.pack, tear.mode, above(), tear.seed);
  auto resonator = stage_resonator();
  resonator.ruling_length_m = tear.cone.ruling_length_m;
  resonator.free_border_length_m = tear.cone.free_border_length_m;
  double before_s = 0;
  for (int k = 1; before_s < tear.seconds + kLead_s; ++k) {
    auto observed = stage.frame(before_s, k * kFrame_s);
    observation::TearEvent event;
    event.id = 1;
    event.speed_m_per_s = tear.speed_m_per_s;
    event.resonators = {resonator};
    observed.tears = {event};
    stage.planner().plan(observed, 0, stage.cues());
    before_s = observed.time_s;
  }
  stage.hand_over();
  auto out = stage.run(std::llround((tear.seconds + kLead_s) * kRate_hz));
  out.erase(out.begin(), out.begin() + static_cast<std::ptrdiff_t>(kLead_s * kRate_hz));
  return out;
}

double kurtosis(std::span<const float> samples) {
  double square = 0, fourth = 0;
  for (const float x : samples) {
    const double x2 = static_cast<double>(x) * x;
    square += x2;
    fourth += x2 * x2;
  }
  return fourth * static_cast<double>(samples.size()) / (square * square);
}

/// Slope of the level over the speed, both in logarithms.
double level_slope(const std::array<double, kSpeeds_m_per_s.size()>& levels_db) {
  double x = 0, y = 0, xx = 0, xy = 0;
  for (std::size_t k = 0; k < levels_db.size(); ++k) {
    const double speed = std::log10(kSpeeds_m_per_s[k]), level = levels_db[k] / 20;
    x += speed, y += level, xx += speed * speed, xy += speed * level;
  }
  constexpr double kCount = kSpeeds_m_per_s.size();
  return (kCount * xy - x * y) / (kCount * xx - x * x);
}

/// Levels by third octaves in dB.
std::vector<report::Point> third_octaves(std::span<const float> samples, double from_hz, double to_hz) {
  const auto density = power_density(samples, 4096);
  std::vector<report::Point> out;
  for (double f = from_hz; f < to_hz * 1.01; f *= std::cbrt(2.0)) {
    const double low = f * std::pow(2, -1.0 / 6), high = f * std::pow(2, 1.0 / 6);
    out.push_back({f, 10 * std::log10(band_power(density, low, high) / (high - low) + 1e-30)});
  }
  return out;
}

double half_range_db(const std::vector<report::Point>& bands) {
  const auto [least, most] = std::minmax_element(bands.begin(), bands.end(), [](auto& a, auto& b) { return a.y < b.y; });
  return (most->y - least->y) / 2;
}

/// Fall from 1-8 kHz, in the mean, to 12.5-16 kHz.
double fall_db(std::span<const float> samples) {
  const auto density = power_density(samples, 4096);
  return 10 * std::log10(band_power(density, 12500, 16000) / 3500 / (band_power(density, 1000, 8000) / 7000));
}

/// Log power along the way torn, every 0.2 mm, of a sound at that speed.
std::vector<double> along_the_way(std::span<const float> samples, double speed_m_per_s, double first_s, double way_m) {
  constexpr double kStep_m = 2e-4;
  std::vector<double> out;
  for (int k = 0; k < static_cast<int>(way_m / kStep_m); ++k) {
    const auto from = static_cast<std::size_t>((first_s + k * kStep_m / speed_m_per_s) * kRate_hz);
    const auto to = static_cast<std::size_t>((first_s + (k + 1) * kStep_m / speed_m_per_s) * kRate_hz);
    double sum = 0;
    for (std::size_t n = from; n < std::min(to, samples.size()); ++n) sum += static_cast<double>(samples[n]) * samples[n];
    out.push_back(std::log(1e-12 + sum));
  }
  return out;
}

/// The ratio of times at which the powers of a tear and of one twice as fast are most alike: 2 where each break comes in
/// half the time.
double time_ratio(const Setting& setting, Mode mode) {
  constexpr double kSlow = 0.05, kFast = 0.1, kFrom_m = 0.02, kWay_m = 0.4;
  // Where a tear at an even speed that came up over the first frame seems to begin, in what torn() returns.
  constexpr double kBegin_s = 0.5 * kFrame_s + static_cast<double>(synthesis::kPathLag) / kRate_hz - kLead_s;
  const auto sound = [&](double speed) {
    return torn({setting.pack, speed, 1.2 * (kFrom_m + kWay_m) / speed, mode, kStagePoint, setting.seed});
  };
  const auto slow = sound(kSlow), fast = sound(kFast);
  const auto reference = along_the_way(fast, kFast, kBegin_s + kFrom_m / kFast, kWay_m);
  double best = 0, most = -2;
  for (double ratio = 1.7; ratio < 2.3; ratio += 0.005) {
    const double r =
        rank_correlation(along_the_way(slow, kFast / ratio, kBegin_s + ratio * kFrom_m / kFast, kWay_m), reference);
    if (r > most) most = r, best = ratio;
  }
  return best;
}

/// Breaks as they come: times at the reference speed, energies.
struct BreakList {
  std::vector<double> energies, waits_s;
  double variation = 0;
};
BreakList breaks(std::uint64_t seed) {
  synthesis::TearBreaks stream(dsp::hash(seed, 1));
  BreakList out;
  double last_m = 0, sum = 0, square = 0;
  for (int k = 0; k < kBreaks; ++k) {
    const auto one = stream.next();
    const double wait_s = (one.at_m - last_m) / synthesis::kReferenceTearSpeed_m_per_s;
    out.energies.push_back(one.energy);
    out.waits_s.push_back(wait_s);
    sum += wait_s / kBreaks;
    square += wait_s * wait_s / kBreaks;
    last_m = one.at_m;
  }
  out.variation = std::sqrt(square - sum * sum) / sum;
  return out;
}

std::span<const float> clip(const std::vector<float>& samples) {
  return std::span(samples).subspan(samples.size() / 2, static_cast<std::size_t>(kClip_s * kRate_hz));
}

report::PlotSeries waveform(std::string name, std::span<const float> samples, report::Ink ink) {
  report::PlotSeries series{std::move(name), {}, ink, report::PlotSeries::Style::kLine};
  for (std::size_t n = 0; n < samples.size(); ++n)
    series.points.push_back({1000.0 * static_cast<double>(n) / kRate_hz, static_cast<double>(samples[n])});
  return series;
}

struct Sounds {
  std::array<std::array<std::vector<float>, kSpeeds_m_per_s.size()>, 2> by_speed;  ///< [mode]
  std::vector<float> published_long, heavy, small_cone, large_cone;
  std::array<double, 2> time_ratio{};
  double level_db(std::size_t mode, std::size_t speed) const { return dsp::rms_dbfs(by_speed[mode][speed]); }
};

Sounds make_sounds(const Setting& setting) {
  auto heavy = std::make_shared<pack::SoundPack>(*setting.pack);
  heavy->grammage_kg_per_m2 *= 2;
  Sounds sounds;
  constexpr std::size_t kSteady = 2 * kSpeeds_m_per_s.size();
  run_all(setting, kSteady + 6, [&](std::size_t k) {
    Tear tear{setting.pack};
    tear.seed = setting.seed;
    if (k < kSteady) {
      tear.mode = k % 2 == 0 ? Mode::kCorrected : Mode::kPublished;
      tear.speed_m_per_s = kSpeeds_m_per_s[k / 2];
      if (tear.mode == Mode::kPublished) tear.seconds = std::max(kSteady_s, 2 / tear.speed_m_per_s);
      sounds.by_speed[k % 2][k / 2] = torn(tear);
      return;
    }
    switch (k - kSteady) {
      case 0:
        tear.mode = Mode::kPublished;
        tear.speed_m_per_s = 1;
        tear.seconds = kLong_s;
        sounds.published_long = torn(tear);
        return;
      case 1:
        tear.pack = heavy;
        sounds.heavy = torn(tear);
        return;
      case 2:
        tear.cone = {0.05, 0.10};
        sounds.small_cone = torn(tear);
        return;
      case 3:
        tear.cone = {0.20, 0.40};
        sounds.large_cone = torn(tear);
        return;
      default:
        sounds.time_ratio[k - kSteady - 4] = time_ratio(setting, k - kSteady == 4 ? Mode::kCorrected : Mode::kPublished);
    }
  });
  return sounds;
}

void add_figures(const Sounds& sounds, Findings& found) {
  constexpr std::size_t kSlow = 1, kFast = 4;  // of kSpeeds_m_per_s
  static_assert(kSpeeds_m_per_s[kSlow] == kSlow_m_per_s && kSpeeds_m_per_s[kFast] == kFast_m_per_s);
  const std::array<std::string, 2> modes = {"ours", "as printed"};
  Pictures pictures;
  report::Plot density;
  density.x = {"frequency (Hz)", true, 100, 20000, {}};
  density.y = {"density (dB)", false, 0, 0, {}};
  for (std::size_t mode = 0; mode < 2; ++mode) {
    const auto &slow = sounds.by_speed[mode][kSlow], &fast = sounds.by_speed[mode][kFast];
    report::Plot waves;
    waves.x = {"time (ms)", false, 0, 1000 * kClip_s, {}};
    waves.y = {"amplitude", false, 0, 0, {}};
    waves.series = {waveform(fmt::format("fast, {} m/s", kFast_m_per_s), clip(fast), report::Ink::kFriction),
                    waveform(fmt::format("slow, {} m/s", kSlow_m_per_s), clip(slow), report::Ink::kCrumpling)};
    found.figures.push_back({fmt::format("Figure 6: a fast and a slow tear, {}", modes[mode]),
                             "The fast one is louder, and its peaks are closer.", waves});
    for (const auto* one : {&slow, &fast}) {
      Picture picture;
      picture.title = fmt::format("{}, {}", one == &slow ? "slow" : "fast", modes[mode]);
      const auto part = clip(*one);
      picture.samples.assign(part.begin(), part.end());
      pictures.pictures.push_back(std::move(picture));
    }
    const auto ink = mode == 0 ? report::Ink::kFriction : report::Ink::kMuted;
    density.series.push_back(
        {"fast, " + modes[mode], third_octaves(fast, 125, 16000), ink, report::PlotSeries::Style::kLine});
    density.series.push_back(
        {"slow, " + modes[mode], third_octaves(slow, 125, 16000), ink, report::PlotSeries::Style::kDashed});
  }
  pictures.rows = 2;
  found.figures.push_back({"Figures 7 and 8: spectrograms of a slow and a fast tear",
                           fmt::format("{:.0f} ms each, at {} and {} m/s.", 1000 * kClip_s, kSlow_m_per_s, kFast_m_per_s),
                           pictures});
  found.figures.push_back({"Figures 7 and 8: power density", "By third octaves.", density});
}

}  // namespace

Findings tearing(const Setting& setting) {
  const Sounds sounds = make_sounds(setting);
  Findings found;
  const auto& slow = sounds.by_speed[0][1];
  const auto& published = sounds.by_speed[1][1];
  std::array<std::array<double, kSpeeds_m_per_s.size()>, 2> levels_db{};
  for (std::size_t mode = 0; mode < 2; ++mode) {
    for (std::size_t k = 0; k < kSpeeds_m_per_s.size(); ++k) levels_db[mode][k] = sounds.level_db(mode, k);
  }
  const auto add = [&](Check check) { found.checks.push_back(std::move(check)); };
  add({"tearing/level", levels_db[0][1], std::nullopt, around(synthesis::kReferenceTear_dbfs, 0.5, "dBFS"), "dBFS",
       "RMS over 10 s of a tear at 0.1 m/s, at 1 m on the axis", levels_db[1][1]});
  add({"tearing/level_slope", level_slope(levels_db[0]), 1.0, around(1, 0.1), "",
       "of the level over the speed, 0.05 to 1 m/s, both in logarithms", level_slope(levels_db[1])});
  add({"tearing/time_ratio", sounds.time_ratio[0], 2.0, around(2, 0.02), "",
       "of the times at which one seed's breaks come, and at double the speed", sounds.time_ratio[1]});
  add({"tearing/flatness", half_range_db(third_octaves(slow, 1000, 8000)), std::nullopt, at_most(3, "dB"), "dB",
       "half of the range of third octaves from 1 to 8 kHz, at the tip of a 10 x 10 cm cone",
       half_range_db(third_octaves(published, 1000, 8000))});
  add({"tearing/fall", fall_db(slow), std::nullopt, at_most(-3, "dB"), "dB", "of 12.5-16 kHz below 1-8 kHz",
       fall_db(published)});
  add({"tearing/kurtosis", kurtosis(sounds.by_speed[0][2]), std::nullopt, between(5, 15), "",
       "at 0.2 m/s; 5.6 to 12 in recordings"});
  add({"tearing/published_kurtosis", kurtosis(sounds.published_long), std::nullopt, around(302.3, 60), "",
       "of noise times r^100, 3 (2α+1)²/(4α+1), over 60 s at 1 m/s"});
  const BreakList list = breaks(setting.seed);
  const double most = *std::max_element(list.energies.begin(), list.energies.end());
  add({"tearing/energy_exponent", fitted_power_law(list.energies, most / synthesis::kTearEnergyRange, most).exponent, 1.25,
       around(1.25, 0.15), "", fmt::format("of {} breaks, maximum likelihood", kBreaks)});
  constexpr double kSpeed = synthesis::kReferenceTearSpeed_m_per_s;
  add({"tearing/waiting_exponent",
       fitted_power_law(list.waits_s, synthesis::kTearLeastGap_m / kSpeed, synthesis::kTearMostGap_m / kSpeed).exponent, 1.0,
       around(1, 0.1), "", "of the times between breaks"});
  add({"tearing/waiting_variation", list.variation, std::nullopt, at_least(1.3), "",
       "coefficient of variation of the times between breaks; 1: not clustered"});
  add({"tearing/grammage", dsp::rms_dbfs(sounds.heavy) - levels_db[0][1], std::nullopt, around(6.02, 0.1, "dB"), "dB",
       "level of paper twice as heavy"});
  const double small_hz = centroid_hz(spectrum_of(sounds.small_cone)),
               large_hz = centroid_hz(spectrum_of(sounds.large_cone));
  add({"tearing/cone_size", small_hz / large_hz, std::nullopt, at_least(1.03), "",
       fmt::format("centroid at the tip of a 5 x 5 cm cone, {:.0f} Hz, over that of a 20 x 20 cm one", small_hz)});
  add_figures(sounds, found);
  return found;
}

}  // namespace rustle::validation
