#include "server/report/html_page.h"

#include <fmt/format.h>

#include "server/report/svg_canvas.h"

namespace rustle::report {
namespace {

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
.pass{color:var(--level);font-weight:650}
.fail{color:var(--limit);font-weight:650}
tr.failed{background:color-mix(in srgb,var(--limit) 9%,transparent)}
td.wrap{white-space:normal}
nav{display:flex;flex-wrap:wrap;gap:6px 16px;font-size:.9rem;margin:0 0 16px}
a{color:var(--friction)}
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

}  // namespace

std::string html_page(std::string_view title, std::string_view subtitle, std::string_view body_markup,
                      std::string_view footer) {
  std::string page = fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{}</title>\n<style>\n"
      ":root{{{}}}\n@media(prefers-color-scheme:dark){{:root{{{}}}}}{}</style>\n</head>\n<body>\n",
      html_escaped(title), css_variables(light_theme(), "#f4f2ed"), css_variables(dark_theme(), "#0e1013"), kStyle);
  page += fmt::format("<header>\n<h1>{}</h1>\n<p class=\"muted\">{}</p>\n</header>\n<main>\n", html_escaped(title),
                      html_escaped(subtitle));
  page += body_markup;
  page += fmt::format("</main>\n<footer>{}</footer>\n</body>\n</html>\n", html_escaped(footer));
  return page;
}

std::string html_drawing(std::string_view id, std::string_view description, double width, double height,
                         std::string_view css_class, const Draw& draw) {
  SvgCanvas canvas(width, height, id, description, css_class);
  draw(canvas, {0, 0, width, height});
  return canvas.markup();
}

std::string html_drawings(std::string_view id, std::string_view description, double wide_height, double narrow_height,
                          const Draw& draw) {
  return html_drawing(fmt::format("{}-wide", id), description, kWidePicture, wide_height, "wide", draw) + "\n" +
         html_drawing(fmt::format("{}-narrow", id), description, kNarrowPicture, narrow_height, "narrow", draw);
}

std::string html_section(std::string_view title, std::string_view body, std::string_view caption) {
  return fmt::format("<section>\n<h2>{}</h2>\n<figure>\n{}\n<figcaption>{}</figcaption>\n</figure>\n</section>\n", title,
                     body, caption);
}

std::string html_tile(std::string_view number, std::string_view label, std::string_view tone) {
  return fmt::format("<li style=\"--tone:var(--{})\"><b>{}</b><span>{}</span></li>\n", tone, html_escaped(number),
                     html_escaped(label));
}

}  // namespace rustle::report
