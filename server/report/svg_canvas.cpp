#include "server/report/svg_canvas.h"

#include <cmath>

#include <fmt/format.h>

#include "server/report/image_canvas.h"

namespace rustle::report {
namespace {

/// At most one decimal, no trailing ".0", no "-0".
std::string number(double value) {
  const double tenths = std::round(value * 10);
  if (tenths == 0) return "0";
  return fmt::format("{}", tenths / 10);
}

std::string colour_of(const Paint& paint) {
  return paint.themed ? fmt::format("var(--{})", ink_name(paint.ink)) : css_colour(paint.colour);
}

std::string fill_of(const Paint& paint) {
  std::string text = fmt::format("fill=\"{}\"", colour_of(paint));
  if (paint.alpha < 1) text += fmt::format(" fill-opacity=\"{:.3g}\"", paint.alpha);
  return text;
}

std::string stroke_of(const Stroke& stroke) {
  std::string text = fmt::format("fill=\"none\" stroke=\"{}\"", colour_of(stroke.paint));
  if (stroke.width != 1) text += fmt::format(" stroke-width=\"{:.3g}\"", stroke.width);
  if (stroke.paint.alpha < 1) text += fmt::format(" stroke-opacity=\"{:.3g}\"", stroke.paint.alpha);
  if (stroke.dashed) text += " stroke-dasharray=\"5 4\"";
  return text;
}

std::string path_of(std::span<const Point> points) {
  std::string path;
  char command = 'M';
  for (const Point& p : points) {
    path += fmt::format("{}{} {}", command, number(p.x), number(p.y));
    command = 'L';
  }
  return path;
}

}  // namespace

std::string html_escaped(std::string_view text) {
  std::string escaped;
  for (const char c : text) {
    switch (c) {
      case '&':
        escaped += "&amp;";
        break;
      case '<':
        escaped += "&lt;";
        break;
      case '>':
        escaped += "&gt;";
        break;
      case '"':
        escaped += "&quot;";
        break;
      case '\'':
        escaped += "&#39;";
        break;
      default:
        escaped += static_cast<unsigned char>(c) < 0x20 || c == 0x7f ? ' ' : c;
    }
  }
  return escaped;
}

std::string base64(std::string_view bytes) {
  constexpr std::string_view alphabet = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const auto byte = [&](std::size_t k) { return k < bytes.size() ? static_cast<unsigned char>(bytes[k]) : 0u; };
    const std::uint32_t group = byte(i) << 16 | byte(i + 1) << 8 | byte(i + 2);
    text += alphabet[group >> 18];
    text += alphabet[(group >> 12) & 63];
    text += i + 1 < bytes.size() ? alphabet[(group >> 6) & 63] : '=';
    text += i + 2 < bytes.size() ? alphabet[group & 63] : '=';
  }
  return text;
}

SvgCanvas::SvgCanvas(double width, double height, std::string_view id, std::string_view description,
                     std::string_view css_class)
    : width_(width), height_(height), id_(id) {
  markup_ = fmt::format("<svg viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\"", number(width), number(height),
                        html_escaped(description));
  if (!css_class.empty()) markup_ += fmt::format(" class=\"{}\"", html_escaped(css_class));
  markup_ += ">\n";
}

void SvgCanvas::rectangle(const Rect& rect, const Paint& fill) {
  markup_ +=
      fmt::format("<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" shape-rendering=\"crispEdges\" {}/>\n", number(rect.x),
                  number(rect.y), number(std::max(0.0, rect.width)), number(std::max(0.0, rect.height)), fill_of(fill));
}

void SvgCanvas::polyline(std::span<const Point> points, const Stroke& stroke) {
  if (points.empty()) return;
  markup_ += fmt::format("<path d=\"{}\" stroke-linejoin=\"round\" {}/>\n", path_of(points), stroke_of(stroke));
}

void SvgCanvas::segments(std::span<const std::pair<Point, Point>> lines, const Stroke& stroke) {
  if (lines.empty()) return;
  std::string path;
  bool sharp = stroke.width <= 1;
  for (const auto& [from, to] : lines) {
    sharp = sharp && (from.x == to.x || from.y == to.y);
    path += fmt::format("M{} {}", number(from.x), number(from.y));
    path += from.x == to.x ? fmt::format("V{}", number(to.y)) : fmt::format("L{} {}", number(to.x), number(to.y));
  }
  markup_ += fmt::format("<path d=\"{}\"{} {}/>\n", path, sharp ? " shape-rendering=\"crispEdges\"" : "", stroke_of(stroke));
}

void SvgCanvas::polygon(std::span<const Point> points, const Paint& fill) {
  if (points.empty()) return;
  markup_ += fmt::format("<path d=\"{}Z\" {}/>\n", path_of(points), fill_of(fill));
}

void SvgCanvas::disc(const Point& centre, double radius, const Paint& fill) {
  markup_ += fmt::format("<circle cx=\"{}\" cy=\"{}\" r=\"{}\" {}/>\n", number(centre.x), number(centre.y), number(radius),
                         fill_of(fill));
}

void SvgCanvas::circle(const Point& centre, double radius, const Stroke& stroke) {
  markup_ += fmt::format("<circle cx=\"{}\" cy=\"{}\" r=\"{}\" {}/>\n", number(centre.x), number(centre.y), number(radius),
                         stroke_of(stroke));
}

void SvgCanvas::text(const Point& position, std::string_view text, const TextStyle& style) {
  markup_ += fmt::format("<text x=\"{}\" y=\"{}\" font-size=\"{}\" {}", number(position.x), number(position.y),
                         number(style.size), fill_of(style.paint));
  if (style.align != Align::kLeft) {
    markup_ += fmt::format(" text-anchor=\"{}\"", style.align == Align::kCentre ? "middle" : "end");
  }
  if (style.bold) markup_ += " font-weight=\"600\"";
  if (style.upward) markup_ += fmt::format(" transform=\"rotate(-90 {} {})\"", number(position.x), number(position.y));
  markup_ += fmt::format(">{}</text>\n", html_escaped(text));
}

void SvgCanvas::image(const Rect& rect, const Image& image) {
  if (image.width < 1 || image.height < 1) return;
  const auto png = encode_png(image);
  if (!png) return;
  markup_ += fmt::format(
      "<image x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" preserveAspectRatio=\"none\" "
      "href=\"data:image/png;base64,{}\"/>\n",
      number(rect.x), number(rect.y), number(rect.width), number(rect.height), base64(*png));
}

void SvgCanvas::clip(const Rect& rect) {
  const std::string name = fmt::format("{}-clip{}", id_, ++clips_);
  markup_ += fmt::format(
      "<clipPath id=\"{0}\"><rect x=\"{1}\" y=\"{2}\" width=\"{3}\" height=\"{4}\"/></clipPath><g "
      "clip-path=\"url(#{0})\">\n",
      name, number(rect.x), number(rect.y), number(rect.width), number(rect.height));
}

void SvgCanvas::unclip() {
  markup_ += "</g>\n";
}

}  // namespace rustle::report
