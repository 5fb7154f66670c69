#include "server/report/html_report.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <string_view>

#include <fmt/format.h>

#include "server/report/axis.h"
#include "server/report/image_canvas.h"
#include "server/report/levels.h"
#include "server/report/spectrogram_picture.h"
#include "server/report/svg_canvas.h"
#include "server/report/timeline.h"

namespace rustle::report {
namespace {

constexpr double kWide = 960, kNarrow = 360, kHalf = 470;
constexpr std::size_t kTableRows = 10;

constexpr std::string_view kStyle = R"css(
*{box-sizing:border-box}
html{color-scheme:light dark;-webkit-text-size-adjust:100%}
body{margin:0;background:var(--page);color:var(--text);
font:15px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,"DejaVu Sans",sans-serif}
main,header,footer{max-width:1080px;margin:0 auto;padding:0 20px}
header{padding-top:32px}
h1{font-size:1.75rem;line-height:1.2;margin:0 0 4px;overflow-wrap:anywhere}
h2{font-size:1.05rem;margin:0 0 4px}
p{margin:0}
.muted,figcaption,footer{color:var(--muted)}
.tiles{display:grid;grid-template-columns:repeat(auto-fit,minmax(136px,1fr));gap:12px;
margin:22px 0 16px;padding:0;list-style:none}
.tiles li{background:var(--background);border:1px solid var(--grid);
border-left:4px solid var(--tone,var(--frame));border-radius:8px;padding:10px 14px}
.tiles b{display:block;font-size:1.5rem;line-height:1.25;font-variant-numeric:tabular-nums;font-weight:650}
.tiles span{color:var(--muted);font-size:.86rem}
section{background:var(--background);border:1px solid var(--grid);border-radius:10px;
padding:18px 20px;margin:0 0 16px}
figure{margin:0}
figcaption{font-size:.86rem;margin-top:6px}
svg{display:block;width:100%;height:auto;
font-family:system-ui,-apple-system,"Segoe UI",Roboto,"DejaVu Sans",sans-serif}
svg.narrow{display:none;max-width:520px;margin:0 auto}
.pair{display:grid;grid-template-columns:1fr 1fr;gap:16px}
.pair section{min-width:0}
dl{display:grid;grid-template-columns:repeat(auto-fill,minmax(210px,1fr));gap:10px 22px;margin:8px 0 0}
dt{color:var(--muted);font-size:.82rem}
dd{margin:0;overflow-wrap:anywhere}
.scroll{overflow-x:auto;margin-top:8px}
table{border-collapse:collapse;width:100%;font-size:.85rem;font-variant-numeric:tabular-nums}
th,td{padding:6px 7px;text-align:right;white-space:nowrap;border-bottom:1px solid var(--grid)}
th{color:var(--muted);font-weight:600;vertical-align:bottom}
thead th{white-space:normal}
th.left,td.left{text-align:left}
tbody tr:last-child td,tbody tr:last-child th{border-bottom:0}
.dot{display:inline-block;width:9px;height:9px;border-radius:50%;background:var(--tone);margin-right:6px}
.notices{border-left:4px solid var(--limit)}
.notices ul{margin:6px 0 0;padding-left:20px}
footer{padding:4px 20px 36px;font-size:.82rem}
@media(max-width:680px){
main,header,footer{padding-left:12px;padding-right:12px}
header{padding-top:20px}
h1{font-size:1.4rem}
section{padding:14px 10px}
section>h2,section>.lead,section dl,figcaption{padding:0 4px}
.pair{grid-template-columns:1fr;gap:0}
.tiles{grid-template-columns:1fr 1fr;gap:8px}
svg.wide{display:none}
svg.narrow{display:block}
}
@media print{body{background:#fff}section{break-inside:avoid}}
)css";

std::string css_variables(const Theme& theme, std::string_view page) {
  std::string text = fmt::format("--page:{}", page);
  for (int i = 0; i < kInks; ++i) {
    text += fmt::format(";--{}:{}", ink_name(static_cast<Ink>(i)), css_colour(theme[static_cast<std::size_t>(i)]));
  }
  return text;
}

std::string db_text(double level_db) {
  return level_db <= kSilenceDb ? "silent" : fmt::format("{:.1f}", level_db);
}

using Draw = std::function<void(Canvas&, const Rect&)>;

std::string drawing(std::string_view id, std::string_view description, double width, double height,
                    std::string_view css_class, const Draw& draw) {
  SvgCanvas canvas(width, height, id, description, css_class);
  draw(canvas, {0, 0, width, height});
  return canvas.markup();
}

/// A drawing for wide windows and one for phones, of which the style shows one.
std::string drawings(std::string_view id, std::string_view description, double wide_height, double narrow_height,
                     const Draw& draw) {
  return drawing(fmt::format("{}-wide", id), description, kWide, wide_height, "wide", draw) + "\n" +
         drawing(fmt::format("{}-narrow", id), description, kNarrow, narrow_height, "narrow", draw);
}

std::string section(std::string_view title, std::string_view body, std::string_view caption) {
  return fmt::format("<section>\n<h2>{}</h2>\n<figure>\n{}\n<figcaption>{}</figcaption>\n</figure>\n</section>\n", title,
                     body, caption);
}

struct Totals {
  std::array<std::size_t, kEventKinds> events{};
  std::array<double, kEventKinds> contact_s{};
};

Totals totals_of(std::span<const EventMark> events) {
  Totals totals;
  for (const EventMark& event : events) {
    const auto kind = static_cast<std::size_t>(event.kind);
    ++totals.events[kind];
    if (event.end_s > event.time_s) totals.contact_s[kind] += event.end_s - event.time_s;
  }
  return totals;
}

/// "crumpling events", "friction episode", "tears".
std::string event_noun(EventKind kind, std::size_t count) {
  constexpr std::array<std::string_view, kEventKinds> nouns = {"crumpling event", "friction episode", "tear"};
  return fmt::format("{}{}", nouns[static_cast<std::size_t>(kind)], count == 1 ? "" : "s");
}

std::string tile(std::string_view number, std::string_view label, std::string_view tone) {
  return fmt::format("<li style=\"--tone:var(--{})\"><b>{}</b><span>{}</span></li>\n", tone, html_escaped(number),
                     html_escaped(label));
}

std::string tiles(const RenderReport& report, const LevelTrack& levels, const Totals& totals) {
  std::string text = "<ul class=\"tiles\" aria-label=\"Headline numbers\">\n";
  const auto count = [&](EventKind kind) { return totals.events[static_cast<std::size_t>(kind)]; };
  for (int k = 0; k < kEventKinds; ++k) {
    const EventKind kind = static_cast<EventKind>(k);
    text += tile(grouped(count(kind)), event_noun(kind, count(kind)), kind_name(kind));
  }
  text += tile(db_text(levels.total_peak_db), "peak dBFS", "level");
  text += tile(db_text(levels.total_rms_db), "RMS dBFS", "level");
  const bool clean = levels.full_scale_samples == 0 && report.limited_samples == 0;
  text += tile(fmt::format("{} / {}", grouped(levels.full_scale_samples), grouped(report.limited_samples)),
               "clipped / limited samples", clean ? "level" : "limit");
  return text + "</ul>\n";
}

std::string facts(const RenderReport& report) {
  std::vector<std::pair<std::string, std::string>> all;
  if (!report.capture.empty()) all.emplace_back("Capture", report.capture);
  all.emplace_back("Simulated", fmt::format("{:.3f} s", report.duration_s));
  all.emplace_back("Mesh frames", grouped(report.mesh_frames));
  all.emplace_back("Sheets", grouped(report.sheets.size()));
  all.emplace_back("Sound", fmt::format("{:.3f} s, {:g} Hz, {}", report.sound.duration_s(), report.sound.rate_hz,
                                        report.sound.channels == 1   ? std::string("mono")
                                        : report.sound.channels == 2 ? std::string("stereo")
                                                                     : fmt::format("{} channels", report.sound.channels)));
  if (!report.mode.empty()) all.emplace_back("Mode", report.mode);
  all.emplace_back("Seed", fmt::format("{}", report.seed));
  if (report.load_s) all.emplace_back("Capture loaded in", fmt::format("{:.2f} s", *report.load_s));
  if (report.render_s) {
    const bool speed = *report.render_s > 0 && report.duration_s > 0;
    all.emplace_back("Rendered in",
                     fmt::format("{:.2f} s{}", *report.render_s,
                                 speed ? fmt::format(" ({} x real time)", short_number(report.duration_s / *report.render_s))
                                       : std::string()));
  }
  all.insert(all.end(), report.facts.begin(), report.facts.end());
  std::string text = "<section>\n<h2>Render</h2>\n<dl>\n";
  for (const auto& [label, value] : all) {
    text += fmt::format("<div><dt>{}</dt><dd>{}</dd></div>\n", html_escaped(label), html_escaped(value));
  }
  text += "</dl>\n";
  if (!report.sheets.empty()) {
    text +=
        "<div class=\"scroll\" role=\"region\" tabindex=\"0\" aria-label=\"Sheets\"><table>\n"
        "<thead><tr><th scope=\"col\" class=\"left\">sheet</th><th scope=\"col\" class=\"left\">name</th>"
        "<th scope=\"col\" class=\"left\">kind</th><th scope=\"col\" class=\"left\">material</th>"
        "<th scope=\"col\">vertices</th><th scope=\"col\">triangles</th></tr></thead>\n<tbody>\n";
    for (const ReportSheet& sheet : report.sheets) {
      text += fmt::format(
          "<tr><th scope=\"row\" class=\"left\">{}</th><td class=\"left\">{}</td><td class=\"left\">{}</td>"
          "<td class=\"left\">{}</td><td>{}</td><td>{}</td></tr>\n",
          sheet.id, html_escaped(sheet.name), html_escaped(sheet.kind), html_escaped(sheet.material),
          grouped(sheet.vertices), grouped(sheet.triangles));
    }
    text += "</tbody></table></div>\n";
  }
  return text + "</section>\n";
}

std::string notices(const RenderReport& report, const LevelTrack& levels) {
  std::vector<std::string> all = report.notices;
  if (levels.non_finite_samples > 0) {
    all.push_back(
        fmt::format("{} samples are not finite numbers; they are counted as 0 here.", grouped(levels.non_finite_samples)));
  }
  if (all.empty()) return "";
  std::string text = "<section class=\"notices\">\n<h2>Notices</h2>\n<ul>\n";
  for (const std::string& notice : all) text += fmt::format("<li>{}</li>\n", html_escaped(notice));
  return text + "</ul>\n</section>\n";
}

std::string largest_table(const RenderReport& report) {
  const std::vector<std::size_t> order = largest_events(report.events, kTableRows);
  std::string text = fmt::format("<section>\n<h2>Largest events</h2>\n<p class=\"muted lead\">{}</p>\n",
                                 order.empty() ? "There are no events."
                                               : "By amplitude against the reference event of their kind (0.16 m; 0.1 m/s). "
                                                 "l_r, l_c: of the event's largest resonator.");
  if (order.empty()) return text + "</section>\n";
  text += "<div class=\"scroll\" role=\"region\" tabindex=\"0\" aria-label=\"Largest events\"><table>\n<thead><tr>";
  for (const std::string_view head : {"time (s)", "kind"}) {
    text += fmt::format("<th scope=\"col\"{}>{}</th>", head == "kind" ? " class=\"left\"" : "", head);
  }
  for (const std::string_view head :
       {"sheet", "amplitude", "re ref. (dB)", "area (cm\u00b2)", "position (m)", "l_r (cm)", "l_c (cm)", "constrained"}) {
    text += fmt::format("<th scope=\"col\">{}</th>", head);
  }
  text += "</tr></thead>\n<tbody>\n";
  for (const std::size_t index : order) {
    const EventMark& event = report.events[index];
    const ResonatorMark* largest = nullptr;
    bool coarse = false;
    for (const ResonatorMark& r : event.resonators) {
      if (largest == nullptr || r.area_m2 > largest->area_m2) largest = &r;
      coarse = coarse || r.coarse;
    }
    const auto centimetres = [&](double metres) { return fmt::format("{:.1f}", 100 * metres); };
    text += fmt::format(
        "<tr><th scope=\"row\">{:.4f}</th><td class=\"left\"><span class=\"dot\" style=\"--tone:var(--{})\"></span>{}</td>"
        "<td>{}</td><td>{} {}</td><td>{:+.1f}</td><td>{}</td><td>{:.3f}, {:.3f}, "
        "{:.3f}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n",
        event.time_s, ink_name(ink_of(event.kind)), kind_name(event.kind), event.sheet, short_number(event.amplitude),
        event.kind == EventKind::kCrumpling ? "m" : "m/s", relative_level_db(event), short_number(1e4 * event.area_m2),
        event.position_m.x(), event.position_m.y(), event.position_m.z(),
        largest != nullptr ? centimetres(largest->ruling_length_m) : "-",
        largest != nullptr && !largest->constrained ? centimetres(largest->free_border_length_m) : "-",
        largest == nullptr ? "-" : fmt::format("{}{}", largest->constrained ? "yes" : "no", coarse ? ", coarse" : ""));
  }
  return text + "</tbody></table></div>\n</section>\n";
}

std::string count_sentence(const Totals& totals) {
  std::string text;
  for (int k = 0; k < kEventKinds; ++k) {
    const auto i = static_cast<std::size_t>(k);
    text += fmt::format("{}{} {}", k > 0 ? ", " : "", grouped(totals.events[i]),
                        event_noun(static_cast<EventKind>(k), totals.events[i]));
    if (totals.contact_s[i] > 0) text += fmt::format(" ({:.1f} s together)", totals.contact_s[i]);
  }
  return text;
}

}  // namespace

std::string html_report(const RenderReport& report) {
  const LevelTrack levels = level_track(report.sound);
  const Totals totals = totals_of(report.events);
  const std::string title = report.title.empty() ? "Rustle render" : report.title;
  const std::string counts = count_sentence(totals);
  const double start_s = report.sound.start_s;
  double end_s = std::max(report.sound.end_s(), start_s + std::max(0.0, report.duration_s));
  for (const EventMark& event : report.events) {
    if (std::isfinite(event.end_s)) end_s = std::max(end_s, event.end_s);
  }

  std::string page = fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{}</title>\n<style>\n"
      ":root{{{}}}\n@media(prefers-color-scheme:dark){{:root{{{}}}}}{}</style>\n</head>\n<body>\n",
      html_escaped(title), css_variables(light_theme(), "#f4f2ed"), css_variables(dark_theme(), "#0e1013"), kStyle);
  page += fmt::format("<header>\n<h1>{}</h1>\n<p class=\"muted\">{}</p>\n</header>\n<main>\n", html_escaped(title),
                      html_escaped(counts));
  page += tiles(report, levels, totals);
  page += notices(report, levels);

  const auto spectrogram = [&](Canvas& canvas, const Rect& rect) {
    SpectrogramOptions options;
    options.cell_scale = rect.width < kWide ? 2 : 1;
    draw_spectrogram(canvas, rect, report.sound, report.events, options);
  };
  page += section(
      "Spectrogram",
      drawings("spectrogram", fmt::format("Spectrogram of {:.1f} s of sound, {}.", report.sound.duration_s(), counts), 440,
               340, spectrogram),
      "Above: crumpling events, longer for larger amplitudes. Below: friction and tearing, stronger when faster. "
      "0 dB is a full-scale sine.");

  const auto level = [&](Canvas& canvas, const Rect& rect) {
    draw_levels(canvas, rect, levels, report.sound.end_s(), report.limit_db);
  };
  const auto waveform = [&](Canvas& canvas, const Rect& rect) { draw_waveform(canvas, rect, report.sound); };
  page += section("Level",
                  drawings("levels",
                           fmt::format("Level over time: peak {} dBFS, RMS {} dBFS.", db_text(levels.total_peak_db),
                                       db_text(levels.total_rms_db)),
                           224, 210, level) +
                      "\n" + drawings("waveform", "Waveform of all channels.", 150, 130, waveform),
                  "RMS and peak of windows of 20 ms; below, the waveform of all channels.");

  std::vector<TimelineSheet> rows;
  for (const ReportSheet& sheet : report.sheets) rows.push_back({sheet.id, sheet.name});
  const TimelineInput input = {report.events, rows, start_s, end_s};
  const double height = timeline_height(input);
  page += section("Events over time",
                  drawings("timeline", fmt::format("Timeline of events per sheet: {}.", counts), height, height,
                           [&](Canvas& canvas, const Rect& rect) { draw_timeline(canvas, rect, input); }),
                  "Crumpling: a line per event, its height the logarithm of its amplitude over three decades. "
                  "Friction and tearing: speed.");

  page += "<div class=\"pair\">\n";
  page += section("Amplitudes",
                  drawing("amplitudes", "Histogram of crumpling amplitudes, both axes logarithmic.", kHalf, 330, "",
                          [&](Canvas& canvas, const Rect& rect) { draw_amplitude_histogram(canvas, rect, report.events); }),
                  "Crumpling events per quarter of a decade.");
  page += section(
      "Resonators",
      drawing("resonators", "Ruling length against free border length of every resonator, over the sound pack's grid.",
              kHalf, 330, "",
              [&](Canvas& canvas, const Rect& rect) { draw_resonators(canvas, rect, report.events, report.pack_grid); }),
      "What the events set vibrating. The nearest grid point gives the sound.");
  page += "</div>\n";
  page += largest_table(report);
  page += facts(report);
  page +=
      "</main>\n<footer>Made by Rustle. Lengths in metres, time in seconds of the simulation, levels relative to full scale."
      "</footer>\n</body>\n</html>\n";
  return page;
}

tl::expected<void, std::string> write_html_report(const std::filesystem::path& path, const RenderReport& report) {
  return write_file(path, html_report(report));
}

}  // namespace rustle::report
