#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "server/report/colour.h"

namespace rustle::report {

/// Pixels, x to the right, y down.
struct Point {
  double x = 0, y = 0;
};
struct Rect {
  double x = 0, y = 0, width = 0, height = 0;
  double right() const { return x + width; }
  double bottom() const { return y + height; }
};

/// Pixels 0x00rrggbb, opaque, row by row from the top.
struct Image {
  int width = 0, height = 0;
  std::vector<std::uint32_t> pixels;  ///< [width * height]
};

std::uint32_t pixel_of(const Colour& colour);

/// A colour of the theme or a fixed one, with an opacity.
struct Paint {
  Paint(Ink an_ink, double an_alpha = 1) : ink(an_ink), alpha(an_alpha) {}
  Paint(const Colour& a_colour, double an_alpha = 1) : themed(false), colour(a_colour), alpha(an_alpha) {}
  bool themed = true;
  Ink ink = Ink::kText;
  Colour colour;
  double alpha = 1;
};

struct Stroke {
  Paint paint;
  double width = 1;
  bool dashed = false;
};

enum class Align : std::uint8_t { kLeft, kCentre, kRight };

struct TextStyle {
  double size = 12;
  Paint paint = Ink::kText;
  Align align = Align::kLeft;
  bool bold = false;
  bool upward = false;  ///< turned a quarter, reading from bottom to top
};

/// Somewhere to draw: pixels (ImageCanvas) or the text of an inline SVG (SvgCanvas). The same calls in the same order draw
/// the same picture on both. Coordinates must be finite.
class Canvas {
 public:
  virtual ~Canvas() = default;
  virtual double width() const = 0;
  virtual double height() const = 0;
  virtual void rectangle(const Rect& rect, const Paint& fill) = 0;
  virtual void polyline(std::span<const Point> points, const Stroke& stroke) = 0;
  /// Unconnected lines of one stroke.
  virtual void segments(std::span<const std::pair<Point, Point>> lines, const Stroke& stroke) = 0;
  virtual void polygon(std::span<const Point> points, const Paint& fill) = 0;
  virtual void disc(const Point& centre, double radius, const Paint& fill) = 0;
  virtual void circle(const Point& centre, double radius, const Stroke& stroke) = 0;
  /// `position` is on the base line. The text is UTF-8.
  virtual void text(const Point& position, std::string_view text, const TextStyle& style) = 0;
  virtual void image(const Rect& rect, const Image& image) = 0;
  /// What is drawn until the matching unclip() shows inside `rect` only. Clips nest.
  virtual void clip(const Rect& rect) = 0;
  virtual void unclip() = 0;

  void line(const Point& from, const Point& to, const Stroke& stroke);
  void frame(const Rect& rect, const Stroke& stroke);
};

/// Width in pixels that a text takes at most in the usual sans-serif fonts: a table, not the machine's fonts, so that a
/// layout is the same everywhere.
double text_width(std::string_view text, double size, bool bold = false);

/// The text, shortened with ".." where it would be wider than `width`.
std::string fitted(std::string_view text, double width, double size, bool bold = false);

/// The lines of a text broken at spaces so that none is wider than `width`; a single longer word is shortened.
std::vector<std::string> wrapped(std::string_view text, double width, double size);

}  // namespace rustle::report
