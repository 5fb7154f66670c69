#include "server/report/canvas.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace rustle::report {
namespace {

/// In em, for the widest of the usual fonts.
double advance(unsigned char c) {
  if (c >= 0x80) return (c & 0xc0) == 0x80 ? 0.0 : 0.75;  // continuation bytes of UTF-8 add nothing
  constexpr std::string_view narrow = "ijl'|", slim = " .,:;!ftrI()[]-/\\\"`", wide = "mwMWQ@%";
  if (narrow.find(static_cast<char>(c)) != std::string_view::npos) return 0.29;
  if (slim.find(static_cast<char>(c)) != std::string_view::npos) return 0.39;
  if (wide.find(static_cast<char>(c)) != std::string_view::npos) return 0.95;
  if (c >= 'A' && c <= 'Z') return 0.70;
  return 0.625;
}

}  // namespace

std::uint32_t pixel_of(const Colour& colour) {
  const auto byte = [](double x) { return static_cast<std::uint32_t>(std::lround(std::clamp(x, 0.0, 1.0) * 255)); };
  return byte(colour.red) << 16 | byte(colour.green) << 8 | byte(colour.blue);
}

void Canvas::line(const Point& from, const Point& to, const Stroke& stroke) {
  const std::array<Point, 2> points = {from, to};
  polyline(points, stroke);
}

void Canvas::frame(const Rect& rect, const Stroke& stroke) {
  const std::array<Point, 5> points = {
      {{rect.x, rect.y}, {rect.right(), rect.y}, {rect.right(), rect.bottom()}, {rect.x, rect.bottom()}, {rect.x, rect.y}}};
  polyline(points, stroke);
}

double text_width(std::string_view text, double size, bool bold) {
  double em = 0;
  for (const char c : text) em += advance(static_cast<unsigned char>(c));
  return em * size * (bold ? 1.11 : 1.0);
}

std::string fitted(std::string_view text, double width, double size, bool bold) {
  if (text_width(text, size, bold) <= width) return std::string(text);
  std::string shorter(text);
  while (!shorter.empty() && text_width(shorter, size, bold) + text_width("..", size, bold) > width) {
    do shorter.pop_back();
    while (!shorter.empty() && (static_cast<unsigned char>(shorter.back()) & 0xc0) == 0x80);
    if (!shorter.empty() && static_cast<unsigned char>(shorter.back()) >= 0xc0) shorter.pop_back();
  }
  return shorter + "..";
}

std::vector<std::string> wrapped(std::string_view text, double width, double size) {
  std::vector<std::string> lines;
  std::string line;
  std::size_t at = 0;
  while (at < text.size()) {
    const std::size_t end = std::min(text.find(' ', at), text.size());
    const std::string_view word = text.substr(at, end - at);
    at = end + 1;
    if (word.empty()) continue;
    std::string longer = line.empty() ? std::string(word) : line + " " + std::string(word);
    if (!line.empty() && text_width(longer, size) > width) {
      lines.push_back(line);
      longer = std::string(word);
    }
    line = fitted(longer, width, size);
  }
  if (!line.empty()) lines.push_back(line);
  return lines;
}

}  // namespace rustle::report
