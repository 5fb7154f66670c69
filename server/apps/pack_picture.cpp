#include "server/apps/pack_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "server/apps/command_pack.h"
#include "server/apps/wording.h"
#include "server/report/axis.h"
#include "server/report/svg_canvas.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/statistics.h"
#include "sound_db/pack/emission.h"
#include "sound_db/pack/spectra.h"

namespace rustle::apps {
namespace {

using report::Align;
using report::Axis;
using report::Canvas;
using report::Ink;
using report::Point;
using report::Rect;

constexpr double kMargin = 24, kTitle = 62, kHeading = 24, kLeft = 56, kBottom = 42;
constexpr double kMostClacs = 16;

/// One value of a grid point: of flaps the mean over its variants.
struct Cell {
  pack::GridPoint point;
  double centroid_hz = 0, level_dbfs = 0;
  int count = 0;
};
using Cells = std::map<std::pair<double, double>, Cell>;

Cells flap_cells(const pack::CrumplingSection& section, double rate_hz) {
  Cells cells;
  const double to_emission_db = dsp::gain_to_db(pack::emission_gain(section.geometry));
  for (const pack::Unit& unit : section.units) {
    if (unit.point.constrained()) continue;
    Cell& cell = cells[{unit.point.ruling_length_m, unit.point.free_border_length_m}];
    cell.point = unit.point;
    cell.centroid_hz += dsp::spectral_centroid_hz(dsp::mean_magnitude(unit.samples, 1024, 256), rate_hz);
    cell.level_dbfs += dsp::peak_dbfs(unit.samples) + to_emission_db;
    ++cell.count;
  }
  for (auto& [key, cell] : cells) {
    cell.centroid_hz /= cell.count;
    cell.level_dbfs /= cell.count;
  }
  return cells;
}

std::vector<float> emission_of(const pack::FrictionSection& section, const pack::Spectrum& spectrum) {
  return pack::emission_spectrum(section, spectrum, static_cast<int>(section.fft_size / 2 + 1), section.rate_hz);
}

Cells friction_cells(const pack::FrictionSection& section) {
  Cells cells;
  for (const pack::Spectrum& spectrum : section.spectra) {
    if (spectrum.point.constrained()) continue;
    const auto emission = emission_of(section, spectrum);
    cells[{spectrum.point.ruling_length_m, spectrum.point.free_border_length_m}] = {
        spectrum.point, dsp::spectral_centroid_hz(emission, section.rate_hz), dsp::gain_to_db(pack::noise_rms(emission)), 1};
  }
  return cells;
}

void heading(Canvas& canvas, const Rect& rect, std::string_view text, std::string_view more = "") {
  canvas.text({rect.x, rect.y + 14}, text, {.size = 14, .paint = Ink::kText, .bold = true});
  if (!more.empty()) {
    canvas.text({rect.x + report::text_width(text, 14, true) + 10, rect.y + 14}, more, {.size = 11.5, .paint = Ink::kMuted});
  }
}

void say(Canvas& canvas, const Rect& plot, std::string_view text) {
  canvas.rectangle(plot, Ink::kPanel);
  canvas.frame(plot, {Ink::kGrid, 1});
  canvas.text({plot.x + plot.width / 2, plot.y + plot.height / 2 + 4}, text,
              {.size = 12, .paint = Ink::kMuted, .align = Align::kCentre});
}

/// A waveform's extremes, a line per pixel column; `full` is the sample that reaches the cell's border.
void draw_waveform(Canvas& canvas, const Rect& cell, std::span<const float> samples, std::size_t most_samples, double full,
                   const report::Paint& paint) {
  const int columns = std::max(1, static_cast<int>(cell.width));
  const double middle = cell.y + cell.height / 2, scale = 0.48 * cell.height / full;
  std::vector<std::pair<Point, Point>> lines;
  for (int c = 0; c < columns; ++c) {
    const auto from = static_cast<std::size_t>(static_cast<double>(most_samples) * c / columns);
    const auto to =
        std::min(samples.size(), static_cast<std::size_t>(static_cast<double>(most_samples) * (c + 1) / columns));
    if (from >= to) break;
    const auto [least, most] = std::minmax_element(samples.begin() + static_cast<std::ptrdiff_t>(from),
                                                   samples.begin() + static_cast<std::ptrdiff_t>(to));
    const double x = cell.x + c + 0.5;
    lines.push_back({{x, middle - scale * *most - 0.4}, {x, middle - scale * *least + 0.4}});
  }
  canvas.segments(lines, {paint, 1});
}

struct GridAxes {
  std::vector<double> rulings_m, borders_m;  // rising
};

GridAxes axes_of(const Cells& cells) {
  std::set<double> rulings, borders;
  for (const auto& [key, cell] : cells) {
    rulings.insert(key.first);
    borders.insert(key.second);
  }
  return {{rulings.begin(), rulings.end()}, {borders.begin(), borders.end()}};
}

/// The cell of a grid point: rulings to the right, edges upward.
Rect cell_of(const Rect& plot, const GridAxes& axes, const pack::GridPoint& point) {
  const auto index = [](const std::vector<double>& values, double value) {
    return static_cast<double>(std::lower_bound(values.begin(), values.end(), value) - values.begin());
  };
  const double width = plot.width / static_cast<double>(axes.rulings_m.size());
  const double height = plot.height / static_cast<double>(axes.borders_m.size());
  return {plot.x + width * index(axes.rulings_m, point.ruling_length_m),
          plot.bottom() - height * (index(axes.borders_m, point.free_border_length_m) + 1), width, height};
}

void draw_grid_axes(Canvas& canvas, const Rect& plot, const GridAxes& axes) {
  const report::TextStyle style = {.size = report::kLabelSize, .paint = Ink::kMuted, .align = Align::kCentre};
  for (const double ruling_m : axes.rulings_m) {
    const Rect cell = cell_of(plot, axes, {ruling_m, axes.borders_m.front()});
    canvas.text({cell.x + cell.width / 2, plot.bottom() + 15}, fmt::format("{:g}", 100 * ruling_m), style);
  }
  for (const double border_m : axes.borders_m) {
    const Rect cell = cell_of(plot, axes, {axes.rulings_m.front(), border_m});
    canvas.text({plot.x - 7, cell.y + cell.height / 2 + 4}, fmt::format("{:g}", 100 * border_m / 2),
                {.size = report::kLabelSize, .paint = Ink::kMuted, .align = Align::kRight});
  }
  canvas.text({plot.x + plot.width / 2, plot.bottom() + 33}, "ruling l_r (cm)", style);
  canvas.text({plot.x - 40, plot.y + plot.height / 2}, "bent edge l_c/2 (cm)",
              {.size = report::kLabelSize, .paint = Ink::kMuted, .align = Align::kCentre, .upward = true});
}

void draw_flaps(Canvas& canvas, const Rect& rect, const pack::SoundPack& pack, const Cells& cells) {
  std::size_t longest = 1;
  double loudest = 1e-9;
  if (pack.crumpling) {
    for (const pack::Unit& unit : pack.crumpling->units) {
      if (unit.point.constrained()) continue;
      longest = std::max(longest, unit.samples.size());
      loudest = std::max(loudest, dsp::peak(unit.samples));
    }
  }
  heading(canvas, rect, "Flaps",
          cells.empty()
              ? ""
              : fmt::format("first unit of each sheet, {:.2f} s wide, {:.1f} dBFS high; number of units at the right",
                            static_cast<double>(longest) / pack.rate_hz, dsp::gain_to_db(loudest)));
  const Rect plot = {rect.x + kLeft, rect.y + kHeading, rect.width - kLeft, rect.height - kHeading - kBottom};
  if (cells.empty()) return say(canvas, plot, "no flaps: sheets that swing freely crumple in silence");
  const GridAxes axes = axes_of(cells);
  canvas.rectangle(plot, Ink::kPanel);
  std::set<std::pair<double, double>> drawn;
  for (const pack::Unit& unit : pack.crumpling->units) {
    const std::pair key = {unit.point.ruling_length_m, unit.point.free_border_length_m};
    if (unit.point.constrained() || !drawn.insert(key).second) continue;
    const Rect cell = cell_of(plot, axes, unit.point);
    draw_waveform(canvas, {cell.x + 2, cell.y + 2, cell.width - 4, cell.height - 4}, unit.samples, longest, loudest,
                  Ink::kCrumpling);
    canvas.text({cell.right() - 4, cell.y + 12}, fmt::format("{}", cells.at(key).count),
                {.size = 10, .paint = Ink::kMuted, .align = Align::kRight});
  }
  std::vector<std::pair<Point, Point>> lines;
  for (std::size_t i = 1; i < axes.rulings_m.size(); ++i) {
    const double x = plot.x + plot.width * static_cast<double>(i) / static_cast<double>(axes.rulings_m.size());
    lines.push_back({{x, plot.y}, {x, plot.bottom()}});
  }
  for (std::size_t i = 1; i < axes.borders_m.size(); ++i) {
    const double y = plot.y + plot.height * static_cast<double>(i) / static_cast<double>(axes.borders_m.size());
    lines.push_back({{plot.x, y}, {plot.right(), y}});
  }
  canvas.segments(lines, {Ink::kGrid, 1});
  canvas.frame(plot, {Ink::kFrame, 1});
  draw_grid_axes(canvas, plot, axes);
}

void draw_clacs(Canvas& canvas, const Rect& rect, const pack::SoundPack& pack) {
  std::vector<const pack::Unit*> clacs;
  std::size_t longest = 1;
  double loudest = 1e-9;
  if (pack.crumpling) {
    for (const pack::Unit& unit : pack.crumpling->units) {
      if (!unit.point.constrained()) continue;
      clacs.push_back(&unit);
      longest = std::max(longest, unit.samples.size());
      loudest = std::max(loudest, dsp::peak(unit.samples));
    }
  }
  heading(canvas, rect, "Clacs",
          clacs.empty() ? ""
                        : fmt::format("{}, {:.0f} ms wide, {:.1f} dBFS high", counted(clacs.size(), "unit"),
                                      1000 * static_cast<double>(longest) / pack.rate_hz, dsp::gain_to_db(loudest)));
  const Rect plot = {rect.x + kLeft, rect.y + kHeading, rect.width - kLeft, rect.height - kHeading};
  if (clacs.empty()) return say(canvas, plot, "no clacs: constrained sheets crumple in silence");
  canvas.rectangle(plot, Ink::kPanel);
  const double count = std::min(static_cast<double>(clacs.size()), kMostClacs), width = plot.width / count;
  for (std::size_t i = 0; static_cast<double>(i) < count; ++i) {
    const double x = plot.x + width * static_cast<double>(i);
    draw_waveform(canvas, {x + 3, plot.y + 2, width - 6, plot.height - 4}, clacs[i]->samples, longest, loudest,
                  Ink::kCrumpling);
    if (i > 0) canvas.line({x, plot.y}, {x, plot.bottom()}, {Ink::kGrid, 1});
  }
  canvas.frame(plot, {Ink::kFrame, 1});
}

/// Colour of a sheet's size, readable on both themes.
report::Colour colour_of_size(double share) {
  return report::from_oklch(0.62, 0.16, 265 - 235 * share);
}

void draw_spectra(Canvas& canvas, const Rect& rect, const pack::SoundPack& pack) {
  heading(canvas, rect, "Friction",
          pack.friction ? fmt::format("spectra at {:g} m/s, at 1 m on the axis without the table",
                                      pack.friction->reference_speed_m_per_s)
                        : "");
  const Rect plot = {rect.x + kLeft, rect.y + kHeading, rect.width - kLeft, rect.height - kHeading - kBottom};
  if (!pack.friction || pack.friction->spectra.empty()) return say(canvas, plot, "no friction: sheets slide in silence");
  const pack::FrictionSection& section = *pack.friction;
  constexpr double kLowest_hz = 100, kBandsPerOctave = 6, kRange_db = 70;
  const double nyquist_hz = section.rate_hz / 2.0;
  struct Curve {
    const pack::Spectrum* spectrum;
    std::vector<std::pair<double, double>> points;  // Hz, dB
  };
  std::vector<Curve> curves;
  double top_db = -300, least_m = 1e9, most_m = 0;
  for (const pack::Spectrum& spectrum : section.spectra) {
    const auto emission = emission_of(section, spectrum);
    Curve curve{&spectrum, {}};
    const double bin_hz = nyquist_hz / static_cast<double>(emission.size() - 1), step = std::pow(2.0, 1 / kBandsPerOctave);
    // Sixths of an octave, or bins where these are wider.
    auto from = static_cast<std::size_t>(std::ceil(kLowest_hz / bin_hz));
    while (from < emission.size()) {
      const auto after = static_cast<std::size_t>(std::lround(static_cast<double>(from) * step));
      const std::size_t to = std::min(emission.size(), std::max(from + 1, after));
      double power = 0;
      for (std::size_t k = from; k < to; ++k) power += static_cast<double>(emission[k]) * emission[k];
      const double density = 2 * power / static_cast<double>(to - from) / section.rate_hz;
      const double db = density > 0 ? 10 * std::log10(density) : -300;
      curve.points.emplace_back(bin_hz * static_cast<double>(from + to - 1) / 2, db);
      top_db = std::max(top_db, db);
      from = to;
    }
    curves.push_back(std::move(curve));
    if (spectrum.point.constrained()) continue;
    least_m = std::min(least_m, spectrum.point.disc_radius_m());
    most_m = std::max(most_m, spectrum.point.disc_radius_m());
  }
  top_db = 10 * std::ceil((top_db + 1) / 10);
  canvas.rectangle(plot, Ink::kPanel);
  const Axis frequency = {kLowest_hz, nyquist_hz, plot.x, plot.right(), true};
  const Axis level = {top_db - kRange_db, top_db, plot.bottom(), plot.y};
  report::draw_horizontal_axis(canvas, plot, frequency, report::logarithmic_ticks(kLowest_hz, nyquist_hz), "frequency (Hz)",
                               Ink::kGrid);
  report::draw_vertical_axis(canvas, plot, level, report::linear_ticks(level.from, level.to, 8), "density (dBFS per Hz)",
                             Ink::kGrid);
  canvas.clip(plot);
  for (const Curve& curve : curves) {
    std::vector<Point> points;
    for (const auto& [hz, db] : curve.points) points.push_back({frequency.pixel(hz), level.clamped_pixel(db)});
    const bool flat = curve.spectrum->point.constrained();
    const double share =
        most_m > least_m ? std::log(curve.spectrum->point.disc_radius_m() / least_m) / std::log(most_m / least_m) : 0.5;
    if (flat) {
      canvas.polyline(points, {Ink::kText, 2.2, true});
    } else {
      canvas.polyline(points, {{colour_of_size(share), curves.size() > 20 ? 0.55 : 0.9}, 1.2});
    }
  }
  canvas.unclip();
  canvas.frame(plot, {Ink::kFrame, 1});
  std::vector<report::LegendEntry> legend;
  if (most_m > 0)
    legend.push_back({"smallest sheet", colour_of_size(most_m > least_m ? 0 : 0.5), report::LegendEntry::Shape::kLine});
  if (most_m > least_m) legend.push_back({"largest sheet", colour_of_size(1), report::LegendEntry::Shape::kLine});
  legend.push_back({"flat", Ink::kText, report::LegendEntry::Shape::kDashedLine});
  if (!curves.back().spectrum->point.constrained() && !curves.front().spectrum->point.constrained()) legend.pop_back();
  report::draw_legend(canvas, {plot.right() - 8 - report::legend_width(legend), plot.y + 16}, legend);
}

void draw_map(Canvas& canvas, const Rect& rect, std::string_view title, std::string_view unit, const Cells& cells,
              double Cell::*value, double divisor, int decimals) {
  heading(canvas, rect, title, unit);
  const Rect plot = {rect.x + kLeft, rect.y + kHeading, rect.width - kLeft, rect.height - kHeading - kBottom};
  if (cells.empty()) return say(canvas, plot, "none");
  const GridAxes axes = axes_of(cells);
  double least = std::numeric_limits<double>::infinity(), most = -least;
  for (const auto& [key, cell] : cells) {
    least = std::min(least, cell.*value);
    most = std::max(most, cell.*value);
  }
  canvas.rectangle(plot, Ink::kPanel);
  for (const auto& [key, cell] : cells) {
    const Rect at = cell_of(plot, axes, cell.point);
    const double share = most > least ? (cell.*value - least) / (most - least) : 0.5;
    const report::Colour colour = report::heat_colour(0.12 + 0.8 * share);
    canvas.rectangle({at.x + 0.5, at.y + 0.5, at.width - 1, at.height - 1}, colour);
    const bool dark = report::oklab_lightness(colour) < 0.6;
    canvas.text({at.x + at.width / 2, at.y + at.height / 2 + 4}, fmt::format("{:.{}f}", cell.*value / divisor, decimals),
                {.size = 10, .paint = dark ? report::Colour{1, 1, 1} : report::Colour{0, 0, 0}, .align = Align::kCentre});
  }
  canvas.frame(plot, {Ink::kFrame, 1});
  draw_grid_axes(canvas, plot, axes);
}

std::string css_of(const report::Theme& theme) {
  std::string css;
  for (int i = 0; i < report::kInks; ++i) {
    css += fmt::format("--{}:{};", report::ink_name(static_cast<Ink>(i)),
                       report::css_colour(theme[static_cast<std::size_t>(i)]));
  }
  return css;
}

}  // namespace

void draw_pack(Canvas& canvas, const pack::SoundPack& pack) {
  canvas.rectangle({0, 0, canvas.width(), canvas.height()}, Ink::kBackground);
  canvas.text({kMargin, 32},
              report::fitted(fmt::format("{} on {}", pack.material, pack.touched_surface), kPackPictureWidth - 2 * kMargin,
                             20, true),
              {.size = 20, .bold = true});
  const std::size_t units = pack.crumpling ? pack.crumpling->units.size() : 0;
  const std::size_t spectra = pack.friction ? pack.friction->spectra.size() : 0;
  const auto about = fmt::format("{} {}; {}, {}; {}, {}; stored at {} Hz", pack.name, pack.version, pack.origin,
                                 pack.licence, counted(units, "unit"),
                                 spectra == 1 ? "1 spectrum" : fmt::format("{} spectra", spectra), pack.stored_rate_hz);
  canvas.text({kMargin, 52}, report::fitted(about, kPackPictureWidth - 2 * kMargin, 12), {.size = 12, .paint = Ink::kMuted});

  const double width = kPackPictureWidth - 2 * kMargin, gap = 28;
  const double upper = 600, clacs = 120, lower = 440;
  const double left = 0.54 * width, right = width - left - gap;
  const Cells flaps = pack.crumpling ? flap_cells(*pack.crumpling, pack.rate_hz) : Cells{};
  const Cells slides = pack.friction ? friction_cells(*pack.friction) : Cells{};
  draw_flaps(canvas, {kMargin, kTitle + 12, left, upper}, pack, flaps);
  draw_spectra(canvas, {kMargin + left + gap, kTitle + 12, right, upper}, pack);
  draw_clacs(canvas, {kMargin, kTitle + 24 + upper, width, clacs}, pack);
  const double y = kTitle + 52 + upper + clacs, map = (width - 3 * gap) / 4;
  const auto place = [&](int i) { return Rect{kMargin + i * (map + gap), y, map, lower}; };
  draw_map(canvas, place(0), "Flaps: centroid", "kHz", flaps, &Cell::centroid_hz, 1000, 1);
  draw_map(canvas, place(1), "Flaps: peak", "dBFS at 1 m", flaps, &Cell::level_dbfs, 1, 0);
  draw_map(canvas, place(2), "Friction: centroid", "kHz", slides, &Cell::centroid_hz, 1000, 1);
  draw_map(canvas, place(3), "Friction: RMS", "dBFS at 1 m", slides, &Cell::level_dbfs, 1, 0);
}

std::string pack_page(const pack::SoundPack& pack) {
  report::SvgCanvas canvas(kPackPictureWidth, kPackPictureHeight, "pack",
                           "waveforms, friction spectra, centroids and levels");
  draw_pack(canvas, pack);
  std::string rows;
  const auto row = [&](const char* kind, const pack::GridPoint& point, const std::string& file, double seconds,
                       double level_dbfs, double centroid_hz) {
    rows += fmt::format("<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{:.1f}</td><td>{:.0f}</td></tr>\n", kind,
                        place_text(point), report::html_escaped(file),
                        seconds > 0 ? fmt::format("{:.0f}", 1000 * seconds) : "", level_dbfs, centroid_hz);
  };
  if (pack.crumpling) {
    for (const pack::Unit& unit : pack.crumpling->units) {
      row(unit.point.constrained() ? "clac" : "flap", unit.point, unit.file,
          static_cast<double>(unit.samples.size()) / pack.rate_hz, dsp::peak_dbfs(unit.samples),
          dsp::spectral_centroid_hz(dsp::mean_magnitude(unit.samples, 1024, 256), pack.rate_hz));
    }
  }
  if (pack.friction) {
    for (const pack::Spectrum& spectrum : pack.friction->spectra) {
      row("friction", spectrum.point, spectrum.file, 0, dsp::gain_to_db(pack::noise_rms(spectrum.magnitudes)),
          dsp::spectral_centroid_hz(spectrum.magnitudes, pack.friction->rate_hz));
    }
  }
  return fmt::format(
      "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" "
      "content=\"width=device-width\"><title>{0}</"
      "title>\n<style>:root{{{1}}}@media(prefers-color-scheme:dark){{:root{{{2}}}}}\n"
      "body{{margin:0;background:var(--background);color:var(--text);font:14px/1.5 "
      "sans-serif}}main{{max-width:1500px;margin:auto}}\n"
      "svg{{width:100%;height:auto}}div{{overflow-x:auto;padding:0 24px 24px}}table{{border-collapse:collapse}}\n"
      "td,th{{padding:2px 14px 2px 0;text-align:left;border-bottom:1px solid "
      "var(--grid)}}td:nth-child(n+4){{text-align:right}}</style>"
      "</head>\n<body><main>{3}<div><table><thead><tr><th>kind</th><th>sheet</th><th>file</th><th>ms</th><th>dBFS (peak; "
      "friction RMS), as recorded</th><th>centroid, "
      "Hz</th></tr></thead><tbody>\n{4}</tbody></table></div></main></body></html>\n",
      report::html_escaped(pack.name), css_of(report::light_theme()), css_of(report::dark_theme()), canvas.markup(), rows);
}

}  // namespace rustle::apps
