#include "server/report/html_report.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include <fmt/format.h>

#include "server/report/axis.h"
#include "server/report/html_page.h"
#include "server/report/image_canvas.h"
#include "server/report/levels.h"
#include "server/report/spectrogram_picture.h"
#include "server/report/svg_canvas.h"
#include "server/report/timeline.h"

namespace rustle::report {
namespace {

constexpr double kHalf = 470;
constexpr std::size_t kTableRows = 10;

std::string db_text(double level_db) {
  return level_db <= kSilenceDb ? "silent" : fmt::format("{:.1f}", level_db);
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

std::string tiles(const RenderReport& report, const LevelTrack& levels, const Totals& totals) {
  std::string text = "<ul class=\"tiles\" aria-label=\"Headline numbers\">\n";
  const auto count = [&](EventKind kind) { return totals.events[static_cast<std::size_t>(kind)]; };
  for (int k = 0; k < kEventKinds; ++k) {
    const EventKind kind = static_cast<EventKind>(k);
    text += html_tile(grouped(count(kind)), event_noun(kind, count(kind)), kind_name(kind));
  }
  text += html_tile(db_text(levels.total_peak_db), "peak dBFS", "level");
  text += html_tile(db_text(levels.total_rms_db), "RMS dBFS", "level");
  const bool clean = levels.full_scale_samples == 0 && report.limited_samples == 0;
  text += html_tile(fmt::format("{} / {}", grouped(levels.full_scale_samples), grouped(report.limited_samples)),
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

  std::string page;
  page += tiles(report, levels, totals);
  page += notices(report, levels);

  const auto spectrogram = [&](Canvas& canvas, const Rect& rect) {
    SpectrogramOptions options;
    options.cell_scale = rect.width < kWidePicture ? 2 : 1;
    draw_spectrogram(canvas, rect, report.sound, report.events, options);
  };
  page += html_section(
      "Spectrogram",
      html_drawings("spectrogram", fmt::format("Spectrogram of {:.1f} s of sound, {}.", report.sound.duration_s(), counts),
                    440, 340, spectrogram),
      "Above: crumpling events, longer for larger amplitudes. Below: friction and tearing, stronger when faster. "
      "0 dB is a full-scale sine.");

  const auto level = [&](Canvas& canvas, const Rect& rect) {
    draw_levels(canvas, rect, levels, report.sound.end_s(), report.limit_db);
  };
  const auto waveform = [&](Canvas& canvas, const Rect& rect) { draw_waveform(canvas, rect, report.sound); };
  page += html_section("Level",
                       html_drawings("levels",
                                     fmt::format("Level over time: peak {} dBFS, RMS {} dBFS.",
                                                 db_text(levels.total_peak_db), db_text(levels.total_rms_db)),
                                     224, 210, level) +
                           "\n" + html_drawings("waveform", "Waveform of all channels.", 150, 130, waveform),
                       "RMS and peak of windows of 20 ms; below, the waveform of all channels.");

  std::vector<TimelineSheet> rows;
  for (const ReportSheet& sheet : report.sheets) rows.push_back({sheet.id, sheet.name});
  const TimelineInput input = {report.events, rows, start_s, end_s};
  const double height = timeline_height(input);
  page += html_section("Events over time",
                       html_drawings("timeline", fmt::format("Timeline of events per sheet: {}.", counts), height, height,
                                     [&](Canvas& canvas, const Rect& rect) { draw_timeline(canvas, rect, input); }),
                       "Crumpling: a line per event, its height the logarithm of its amplitude over three decades. "
                       "Friction and tearing: speed.");

  page += "<div class=\"pair\">\n";
  page += html_section(
      "Amplitudes",
      html_drawing("amplitudes", "Histogram of crumpling amplitudes, both axes logarithmic.", kHalf, 330, "",
                   [&](Canvas& canvas, const Rect& rect) { draw_amplitude_histogram(canvas, rect, report.events); }),
      "Crumpling events per quarter of a decade.");
  page += html_section(
      "Resonators",
      html_drawing(
          "resonators", "Ruling length against free border length of every resonator, over the sound pack's grid.", kHalf,
          330, "",
          [&](Canvas& canvas, const Rect& rect) { draw_resonators(canvas, rect, report.events, report.pack_grid); }),
      "What the events set vibrating. The nearest grid point gives the sound.");
  page += "</div>\n";
  page += largest_table(report);
  page += facts(report);
  return html_page(title, counts, page,
                   "Made by Rustle. Lengths in metres, time in seconds of the simulation, levels relative to full scale.");
}

tl::expected<void, std::string> write_html_report(const std::filesystem::path& path, const RenderReport& report) {
  return write_file(path, html_report(report));
}

}  // namespace rustle::report
