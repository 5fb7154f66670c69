#include "server/validation/page.h"

#include <fmt/format.h>

#include <cmath>

#include "server/report/html_page.h"
#include "server/report/image_canvas.h"
#include "server/report/spectrogram_picture.h"
#include "server/report/svg_canvas.h"

namespace rustle::validation {
namespace {

using report::html_escaped;

constexpr double kPanelGap = 8;

std::string with_unit(std::optional<double> value, const std::string& unit) {
  if (!value) return "";
  return unit.empty() ? figure_text(*value) : fmt::format("{} {}", figure_text(*value), unit);
}

std::string check_table(const Findings& findings) {
  bool paper = false, published = false;
  for (const Check& check : findings.checks) {
    paper = paper || check.paper;
    published = published || check.published;
  }
  std::string text =
      "<div class=\"scroll\" role=\"region\" tabindex=\"0\" aria-label=\"Checks\"><table>\n<thead><tr>"
      "<th scope=\"col\" class=\"left\">check</th><th scope=\"col\">ours</th>";
  if (paper) text += "<th scope=\"col\">paper</th>";
  if (published) text += "<th scope=\"col\">formulas as printed</th>";
  text +=
      "<th scope=\"col\" class=\"left\">bound</th><th scope=\"col\" class=\"left\">holds</th>"
      "<th scope=\"col\" class=\"left\">what</th></tr></thead>\n<tbody>\n";
  for (const Check& check : findings.checks) {
    const std::string name = check.name.substr(check.name.find('/') + 1);
    text +=
        fmt::format("<tr{}><th scope=\"row\" class=\"left\">{}</th><td>{}</td>", check.holds() ? "" : " class=\"failed\"",
                    html_escaped(name), html_escaped(with_unit(check.ours, check.unit)));
    if (paper) text += fmt::format("<td>{}</td>", html_escaped(with_unit(check.paper, check.unit)));
    if (published) text += fmt::format("<td>{}</td>", html_escaped(with_unit(check.published, check.unit)));
    text += fmt::format("<td class=\"left\">{}</td><td class=\"left {}\">{}</td><td class=\"left wrap\">{}</td></tr>\n",
                        html_escaped(check.bound.text), check.holds() ? "pass" : "fail", check.holds() ? "yes" : "no",
                        html_escaped(check.meaning));
  }
  return text + "</tbody></table></div>\n";
}

/// In columns of `rows` pictures each.
void draw_pictures(report::Canvas& canvas, const report::Rect& rect, const std::vector<Picture>& pictures,
                   std::size_t rows) {
  const std::size_t columns = (pictures.size() + rows - 1) / rows;
  const double width = (rect.width - kPanelGap * static_cast<double>(columns - 1)) / static_cast<double>(columns);
  const double height = (rect.height - kPanelGap * static_cast<double>(rows - 1)) / static_cast<double>(rows);
  for (std::size_t k = 0; k < pictures.size(); ++k) {
    const report::Rect part = {rect.x + static_cast<double>(k / rows) * (width + kPanelGap),
                               rect.y + static_cast<double>(k % rows) * (height + kPanelGap), width, height};
    report::SpectrogramOptions options;
    options.title = pictures[k].title;
    options.lowest_hz = pictures[k].lowest_hz;
    options.range_db = 70;
    report::draw_spectrogram(canvas, part, {pictures[k].samples, 1, pictures[k].rate_hz, 0}, {}, options);
  }
}

std::string figure_markup(const std::string& id, const Figure& figure) {
  if (const auto* plot = std::get_if<report::Plot>(&figure.content)) {
    return report::html_drawings(id, figure.title, 360, 300, [&](report::Canvas& canvas, const report::Rect& rect) {
      report::draw_plot(canvas, rect, *plot);
    });
  }
  const auto& shown = std::get<Pictures>(figure.content);
  const auto draw = [&](std::size_t rows) {
    return [&shown, rows](report::Canvas& canvas, const report::Rect& rect) {
      draw_pictures(canvas, rect, shown.pictures, rows);
    };
  };
  const auto rows = static_cast<std::size_t>(shown.rows);
  return report::html_drawing(id + "-wide", figure.title, report::kWidePicture, shown.rows == 1 ? 330 : 270 * shown.rows,
                              "wide", draw(rows)) +
         "\n" +
         report::html_drawing(id + "-narrow", figure.title, report::kNarrowPicture,
                              250 * static_cast<double>(shown.pictures.size()), "narrow", draw(shown.pictures.size()));
}

}  // namespace

std::string figure_text(double value) {
  if (!std::isfinite(value)) return "none";
  const double size = std::abs(value);
  if (size >= 1000) return fmt::format("{:.0f}", value);
  if (size >= 100) return fmt::format("{:.1f}", value);
  if (size >= 1) return fmt::format("{:.2f}", value);
  if (size >= 0.01 || size == 0) return fmt::format("{:.3f}", value);
  return fmt::format("{:.2g}", value);
}

std::string page(const std::vector<GroupFindings>& all, const std::vector<std::pair<std::string, std::string>>& facts) {
  const Verdict sum = verdict(all);
  std::string body = "<ul class=\"tiles\" aria-label=\"Headline numbers\">\n";
  body += report::html_tile(fmt::format("{} / {}", sum.checks - sum.failed, sum.checks), "checks hold",
                            sum.failed == 0 ? "level" : "limit");
  for (const auto& [group, findings] : all) {
    std::size_t holding = 0;
    for (const Check& check : findings.checks) holding += check.holds() ? 1 : 0;
    if (findings.checks.empty()) continue;
    body += report::html_tile(fmt::format("{} / {}", holding, findings.checks.size()), group->title,
                              holding == findings.checks.size() ? "level" : "limit");
  }
  body += "</ul>\n";
  body += "<nav aria-label=\"Parts\">";
  for (const auto& [group, findings] : all) {
    body += fmt::format("<a href=\"#{}\">{}</a>", group->name, html_escaped(group->title));
  }
  body += "</nav>\n";
  for (const auto& [group, findings] : all) {
    body += fmt::format("<section id=\"{}\">\n<h2>{}</h2>\n<p class=\"muted lead\">{}.</p>\n", group->name,
                        html_escaped(group->title), html_escaped(group->about));
    if (!findings.checks.empty()) body += check_table(findings);
    if (!findings.notices.empty()) {
      body += fmt::format("<details><summary>{} notices</summary><ul>\n", findings.notices.size());
      for (const auto& notice : findings.notices) body += fmt::format("<li>{}</li>\n", html_escaped(notice));
      body += "</ul></details>\n";
    }
    body += "</section>\n";
    for (std::size_t k = 0; k < findings.figures.size(); ++k) {
      const Figure& figure = findings.figures[k];
      body += report::html_section(html_escaped(figure.title), figure_markup(fmt::format("{}-{}", group->name, k), figure),
                                   html_escaped(figure.caption));
    }
  }
  if (!facts.empty()) {
    body += "<section>\n<h2>This run</h2>\n<dl>\n";
    for (const auto& [label, value] : facts) {
      body += fmt::format("<div><dt>{}</dt><dd>{}</dd></div>\n", html_escaped(label), html_escaped(value));
    }
    body += "</dl>\n</section>\n";
  }
  return report::html_page(
      "Rustle beside the papers",
      sum.failed == 0 ? fmt::format("All {} checks hold", sum.checks)
                      : fmt::format("{} of {} checks do not hold", sum.failed, sum.checks),
      body,
      "Made by Rustle. Papers: Schreck, Rohmer, James, Hahmann, Cani: Real-time sound synthesis for paper "
      "material based on geometric analysis, SCA 2016; Lejemble et al.: Interactive procedural simulation of paper tearing "
      "with sound, MIG 2015.");
}

}  // namespace rustle::validation
