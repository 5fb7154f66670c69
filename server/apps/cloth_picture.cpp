#include "server/apps/cloth_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "server/apps/wording.h"
#include "server/report/image_canvas.h"
#include "server/report/plot.h"
#include "server/report/spectrogram_picture.h"
#include "server/report/svg_canvas.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/statistics.h"
#include "sound_db/dsp/unit_features.h"

namespace rustle::apps {
namespace {

using report::Canvas;
using report::Ink;
using report::Plot;
using report::PlotSeries;
using report::Point;
using report::Rect;

constexpr double kMargin = 24, kTitle = 62, kHeading = 26, kGap = 24;
constexpr double kSweep_s = 6, kExcerpt_s = 6;
constexpr std::size_t kMostDots = 2500;
const report::Colour kTargetColour = report::from_oklch(0.62, 0.24, 330);
const report::Colour kSourceColour = report::from_oklch(0.66, 0.17, 145);

void heading(Canvas& canvas, const Rect& rect, const std::string& title, const std::string& about) {
  canvas.text({rect.x, rect.y + 14}, title, {.size = 14, .bold = true});
  const double taken = report::text_width(title, 14, true) + 12;
  canvas.text({rect.x + taken, rect.y + 14}, report::fitted(about, rect.width - taken, report::kLabelSize),
              {.size = report::kLabelSize, .paint = Ink::kMuted});
}

Rect below_heading(const Rect& rect) {
  return {rect.x, rect.y + kHeading, rect.width, rect.height - kHeading};
}

void draw_sound(Canvas& canvas, const Rect& rect, std::span<const float> samples, std::uint32_t rate_hz) {
  report::Sound sound;
  sound.samples = samples;
  sound.rate_hz = rate_hz;
  report::SpectrogramOptions options;
  options.lowest_hz = 100;
  report::draw_spectrogram(canvas, below_heading(rect), sound, {}, options);
}

/// From the slowest measured speed to the fastest, rising exponentially.
std::vector<float> sweep_sound(const pack::ClothCorpus& corpus) {
  const double slow = corpus.friction.speeds_m_per_s.front(), fast = corpus.friction.speeds_m_per_s.back();
  const auto speed_at = [&](double t) { return slow * std::pow(fast / slow, std::clamp(t / kSweep_s, 0.0, 1.0)); };
  return pack::plain_target(corpus, kSweep_s, speed_at, {}, 1);
}

/// The start of the recordings, up to kExcerpt_s.
std::vector<float> excerpt(const pack::ClothCorpus& corpus) {
  std::vector<float> samples;
  const auto most = static_cast<std::size_t>(kExcerpt_s * corpus.rate_hz);
  for (const auto& recording : corpus.recordings) {
    const auto& channel = recording.channels.front();
    const std::size_t count = std::min(channel.size(), most - samples.size());
    samples.insert(samples.end(), channel.begin(), channel.begin() + static_cast<std::ptrdiff_t>(count));
    if (samples.size() == most) break;
  }
  return samples;
}

/// Power density over sixths of an octave.
std::vector<Point> spectrum_points(std::span<const float> magnitudes, double rate_hz) {
  constexpr double kLowest_hz = 100;
  const double bin_hz = rate_hz / 2 / static_cast<double>(magnitudes.size() - 1), step = std::pow(2.0, 1.0 / 6);
  std::vector<Point> points;
  auto from = static_cast<std::size_t>(std::ceil(kLowest_hz / bin_hz));
  while (from < magnitudes.size()) {
    const auto after = static_cast<std::size_t>(std::lround(static_cast<double>(from) * step));
    const std::size_t to = std::min(magnitudes.size(), std::max(from + 1, after));
    double power = 0;
    for (std::size_t k = from; k < to; ++k) power += static_cast<double>(magnitudes[k]) * magnitudes[k];
    const double density = 2 * power / static_cast<double>(to - from) / rate_hz;
    points.push_back({bin_hz * static_cast<double>(from + to - 1) / 2, 10 * std::log10(std::max(density, 1e-20))});
    from = to;
  }
  return points;
}

void draw_friction(Canvas& canvas, const Rect& rect, const pack::ClothCorpus& corpus) {
  const pack::FrictionSweep& sweep = corpus.friction;
  heading(canvas, rect, "Friction", fmt::format("measured spectra of {:g} cm², dBFS per Hz", 1e4 * sweep.patch_area_m2));
  Plot plot;
  plot.x = {"frequency (Hz)", true, 100, corpus.rate_hz / 2.0, {}};
  plot.y.title = "density (dBFS per Hz)";
  const std::size_t count = sweep.speeds_m_per_s.size();
  for (std::size_t i = 0; i < count; ++i) {
    const double share = count > 1 ? static_cast<double>(i) / static_cast<double>(count - 1) : 0.5;
    const bool named = i == 0 || i + 1 == count;
    plot.series.push_back({named ? fmt::format("{:.2g} m/s", sweep.speeds_m_per_s[i]) : "",
                           spectrum_points(sweep.spectrum(i), corpus.rate_hz),
                           report::from_oklch(0.62, 0.16, 265 - 235 * share), PlotSeries::Style::kLine});
  }
  report::draw_plot(canvas, below_heading(rect), plot);
}

void draw_levels(Canvas& canvas, const Rect& rect, const pack::ClothCorpus& corpus) {
  heading(canvas, rect, "Level by speed", "linear between the measurements, with the square below, constant above");
  const auto& speeds = corpus.friction.speeds_m_per_s;
  Plot plot;
  plot.x = {"speed (m/s)", true, speeds.front() / 4, speeds.back() * 2, {}};
  plot.y.title = "RMS (dBFS)";
  PlotSeries line{"", {}, Ink::kFriction, PlotSeries::Style::kLine};
  for (double s = plot.x.from; s <= plot.x.to; s *= 1.05) {
    line.points.push_back({s, dsp::gain_to_db(pack::friction_rms(corpus.friction, s))});
  }
  PlotSeries dots{"measured", {}, Ink::kFriction, PlotSeries::Style::kDots};
  for (std::size_t i = 0; i < speeds.size(); ++i)
    dots.points.push_back({speeds[i], dsp::gain_to_db(corpus.friction.rms[i])});
  plot.series = {line, dots};
  report::draw_plot(canvas, below_heading(rect), plot);
}

PlotSeries feature_dots(const std::string& label, std::span<const float> values, std::size_t dims, std::size_t x,
                        std::size_t y, const report::Colour& colour) {
  PlotSeries dots{label, {}, report::Paint(colour, 0.45), PlotSeries::Style::kDots};
  const std::size_t units = values.size() / dims, step = std::max<std::size_t>(1, units / kMostDots);
  for (std::size_t i = 0; i < units; i += step) dots.points.push_back({values[i * dims + x], values[i * dims + y]});
  return dots;
}

void draw_features(Canvas& canvas, const Rect& rect, const pack::ClothCorpus& corpus) {
  heading(canvas, rect, "Units",
          fmt::format("{} of {:.1f} ms; features filtered causally over {} units",
                      report::grouped(static_cast<std::uint64_t>(corpus.units())), 1000 * corpus.unit_s,
                      fmt::join(corpus.selection.filter_widths, ", ")));
  Plot plot;
  plot.x.title = "MFCC 1";
  plot.y.title = "MFCC 2";
  plot.series = {feature_dots("", corpus.causal.values, corpus.dims(), 0, 1, kSourceColour)};
  report::draw_plot(canvas, below_heading(rect), plot);
}

void draw_energies(Canvas& canvas, const Rect& rect, const pack::ClothCorpus& corpus) {
  if (!corpus.crumpling || corpus.crumpling->units.empty()) {
    heading(canvas, rect, "Crumpling", "none: it is too quiet to matter, or was not recorded");
    return;
  }
  const auto& units = corpus.crumpling->units;
  heading(canvas, rect, "Crumpling", fmt::format("energies of {}", counted(units.size(), "unit")));
  Plot plot;
  plot.x = {"energy (s)", true, 0, 0, {}};
  plot.y.title = "louder than so many units";
  PlotSeries line{"", {}, Ink::kCrumpling, PlotSeries::Style::kDots};
  for (std::size_t i = 0; i < units.size(); ++i) line.points.push_back({units[i].energy_s, static_cast<double>(i)});
  plot.series = {line};
  report::draw_plot(canvas, below_heading(rect), plot);
}

std::string css_of(const report::Theme& theme) {
  std::string css;
  for (int i = 0; i < report::kInks; ++i) {
    css += fmt::format("--{}:{};", report::ink_name(static_cast<Ink>(i)),
                       report::css_colour(theme[static_cast<std::size_t>(i)]));
  }
  return css;
}

void draw_title(Canvas& canvas, const std::string& title, const std::string& about) {
  canvas.rectangle({0, 0, canvas.width(), canvas.height()}, Ink::kBackground);
  const double width = canvas.width() - 2 * kMargin;
  canvas.text({kMargin, 32}, report::fitted(title, width, 20, true), {.size = 20, .bold = true});
  canvas.text({kMargin, 52}, report::fitted(about, width, 12), {.size = 12, .paint = Ink::kMuted});
}

/// The means of each correspondence's units in a set of features.
PlotSeries centroids(const std::string& label, std::span<const float> values, std::size_t dims, std::size_t x, std::size_t y,
                     std::span<const std::pair<std::size_t, std::size_t>> intervals, const report::Colour& colour) {
  PlotSeries rings{label, {}, colour, PlotSeries::Style::kRings};
  for (const auto& [first, count] : intervals) {
    Point mean;
    for (std::size_t i = first; i < first + count; ++i) {
      mean.x += values[i * dims + x] / static_cast<double>(count);
      mean.y += values[i * dims + y] / static_cast<double>(count);
    }
    rings.points.push_back(mean);
  }
  return rings;
}

}  // namespace

void draw_cloth_pack(Canvas& canvas, const pack::SoundPack& pack) {
  const pack::ClothCorpus& corpus = *pack.cloth;
  const double seconds = static_cast<double>(corpus.units()) * corpus.unit_s;
  draw_title(canvas, fmt::format("{} on {}", pack.material, pack.touched_surface),
             fmt::format("{} {}; {}, {}; {} of {:.0f} s in all, {} at {} Hz; warp with {} nodes, λ {:g}; L {}, d_max {:g}",
                         pack.name, pack.version, pack.origin, pack.licence, counted(corpus.recordings.size(), "recording"),
                         seconds, counted(static_cast<std::uint64_t>(corpus.channels), "channel"), pack.stored_rate_hz,
                         corpus.causal.warp.node_count(), corpus.selection.lambda, corpus.selection.look_ahead,
                         corpus.selection.greatest_distance));
  const double half = (kClothPictureWidth - 2 * kMargin - kGap) / 2,
               third = (kClothPictureWidth - 2 * kMargin - 2 * kGap) / 3;
  const double row = (kClothPictureHeight - kTitle - 12 - 3 * kGap) / 3;
  const auto y = [&](int i) { return kTitle + 12 + i * (row + kGap); };
  const Rect sweep{kMargin, y(0), half, row}, recording{kMargin + half + kGap, y(0), half, row};
  heading(canvas, sweep, "Sweep",
          fmt::format("friction from {:.2g} to {:.2g} m/s, rising exponentially", corpus.friction.speeds_m_per_s.front(),
                      corpus.friction.speeds_m_per_s.back()));
  draw_sound(canvas, sweep, sweep_sound(corpus), corpus.rate_hz);
  heading(canvas, recording, "Corpus", fmt::format("its first {:.0f} s", kExcerpt_s));
  draw_sound(canvas, recording, excerpt(corpus), corpus.rate_hz);
  draw_friction(canvas, {kMargin, y(1), half, row}, corpus);
  draw_levels(canvas, {kMargin + half + kGap, y(1), half, row}, corpus);
  draw_features(canvas, {kMargin, y(2), 2 * third + kGap, row}, corpus);
  draw_energies(canvas, {kMargin + 2 * (third + kGap), y(2), third, row}, corpus);
}

std::string cloth_pack_page(const pack::SoundPack& pack) {
  const pack::ClothCorpus& corpus = *pack.cloth;
  report::SvgCanvas canvas(kClothPictureWidth, kClothPictureHeight, "pack",
                           "a friction sweep, the corpus, spectra and levels by speed, features and crumpling energies");
  draw_cloth_pack(canvas, pack);
  std::string rows;
  const auto row = [&](const char* kind, const std::string& file, std::span<const float> samples) {
    rows += fmt::format("<tr><td>{}</td><td>{}</td><td>{:.0f}</td><td>{:.1f}</td><td>{:.0f}</td></tr>\n", kind,
                        report::html_escaped(file), 1000 * static_cast<double>(samples.size()) / corpus.rate_hz,
                        dsp::rms_dbfs(samples),
                        dsp::spectral_centroid_hz(dsp::mean_magnitude(samples, 1024, 256), corpus.rate_hz));
  };
  for (const auto& recording : corpus.recordings) row("recording", recording.file, recording.channels.front());
  if (corpus.crumpling) {
    for (const auto& unit : corpus.crumpling->units) row("crumpling", unit.file, unit.samples);
  }
  return fmt::format(
      "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" "
      "content=\"width=device-width\"><title>{0}</title>\n"
      "<style>:root{{{1}}}@media(prefers-color-scheme:dark){{:root{{{2}}}}}\n"
      "body{{margin:0;background:var(--background);color:var(--text);font:14px/1.5 "
      "sans-serif}}main{{max-width:1500px;margin:auto}}\n"
      "svg{{width:100%;height:auto}}div{{overflow-x:auto;padding:0 24px 24px}}table{{border-collapse:collapse}}\n"
      "td,th{{padding:2px 14px 2px 0;text-align:left;border-bottom:1px solid "
      "var(--grid)}}td:nth-child(n+3){{text-align:right}}</style></head>\n"
      "<body><main>{3}<div><table><thead><tr><th>kind</th><th>file</th><th>ms</th><th>RMS, dBFS</th><th>centroid, "
      "Hz</th></tr></thead><tbody>\n{4}</tbody></table></div></main></body></html>\n",
      report::html_escaped(pack.name), css_of(report::light_theme()), css_of(report::dark_theme()), canvas.markup(), rows);
}

void draw_warp(Canvas& canvas, const pack::SoundPack& pack, const pack::TargetFeatures& target,
               std::span<const pack::Correspondence> correspondences) {
  const pack::ClothCorpus& corpus = *pack.cloth;
  const std::size_t dims = target.dims;
  draw_title(canvas, fmt::format("{}: from target to corpus", pack.material),
             fmt::format("{}; λ {:g}; rings: means of the corresponding clips",
                         counted(correspondences.size(), "correspondence"), corpus.selection.lambda));
  std::vector<float> warped(target.causal.size());
  for (std::size_t i = 0; i < target.units; ++i) {
    dsp::warp(corpus.causal.warp, std::span(target.causal).subspan(i * dims, dims),
              std::span(warped).subspan(i * dims, dims));
  }
  std::vector<std::pair<std::size_t, std::size_t>> of_target, of_source;
  for (const pack::Correspondence& pair : correspondences) {
    const pack::UnitInterval units = pack::units_of(pair, corpus, target.units);
    if (units.count == 0) continue;
    of_target.emplace_back(units.target, units.count);
    of_source.emplace_back(units.database, units.count);
  }
  const double width = (kWarpPictureWidth - 2 * kMargin - kGap) / 2,
               height = (kWarpPictureHeight - kTitle - 12 - 2 * kGap) / 2;
  for (const bool after : {false, true}) {
    for (std::size_t y = 1; y < dsp::kUnitFeatures; ++y) {
      const Rect rect{kMargin + (after ? width + kGap : 0), kTitle + 12 + static_cast<double>(y - 1) * (height + kGap),
                      width, height};
      heading(canvas, rect, after ? "After" : "Before", "");
      const std::span<const float> from = after ? std::span<const float>(warped) : std::span<const float>(target.causal);
      Plot plot;
      plot.x.title = "MFCC 1";
      plot.y.title = fmt::format("MFCC {}", y + 1);
      plot.series = {feature_dots("corpus", corpus.causal.values, dims, 0, y, kSourceColour),
                     feature_dots("target", from, dims, 0, y, kTargetColour),
                     centroids("", corpus.causal.values, dims, 0, y, of_source, report::from_oklch(0.8, 0.2, 145)),
                     centroids("", from, dims, 0, y, of_target, report::from_oklch(0.75, 0.22, 330))};
      report::draw_plot(canvas, below_heading(rect), plot);
    }
  }
}

}  // namespace rustle::apps
