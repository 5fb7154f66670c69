#pragma once

#include <string>

#include "server/report/canvas.h"

namespace rustle::report {

/// Draws into the text of an inline `<svg>`, its colours being the page's CSS variables (`--crumpling` ...), so that one
/// drawing serves light and dark. No scripts, no links; pictures are data URIs. Coordinates are rounded to 0.1.
class SvgCanvas final : public Canvas {
 public:
  /// `description` is read out instead of the picture. `id` is unique in the page (letters, digits, '-').
  SvgCanvas(double width, double height, std::string_view id, std::string_view description, std::string_view css_class = "");

  double width() const override { return width_; }
  double height() const override { return height_; }
  void rectangle(const Rect& rect, const Paint& fill) override;
  void polyline(std::span<const Point> points, const Stroke& stroke) override;
  void segments(std::span<const std::pair<Point, Point>> lines, const Stroke& stroke) override;
  void polygon(std::span<const Point> points, const Paint& fill) override;
  void disc(const Point& centre, double radius, const Paint& fill) override;
  void circle(const Point& centre, double radius, const Stroke& stroke) override;
  void text(const Point& position, std::string_view text, const TextStyle& style) override;
  void image(const Rect& rect, const Image& image) override;
  void clip(const Rect& rect) override;
  void unclip() override;

  /// The whole element.
  std::string markup() const { return markup_ + "</svg>"; }

 private:
  double width_, height_;
  std::string id_;
  int clips_ = 0;
  std::string markup_;
};

/// For text and attribute values: & < > " ' become entities, control characters spaces.
std::string html_escaped(std::string_view text);

std::string base64(std::string_view bytes);

}  // namespace rustle::report
