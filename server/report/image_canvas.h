#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include <tl/expected.hpp>

#include "server/report/canvas.h"

namespace rustle::report {

/// Draws into pixels with Cairo. Fonts come from the machine ("sans-serif"); one without any draws with Cairo's own stroke
/// font. One thread at a time.
class ImageCanvas final : public Canvas {
 public:
  /// \pre 1 <= width_px, height_px <= 16384; scale (pixels per unit of the drawing) in (0, 4]
  ImageCanvas(int width, int height, const Theme& theme, double scale = 1);
  ~ImageCanvas() override;
  ImageCanvas(const ImageCanvas&) = delete;
  ImageCanvas& operator=(const ImageCanvas&) = delete;

  double width() const override;
  double height() const override;
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

  Image pixels() const;

 private:
  struct Surface;
  std::unique_ptr<Surface> surface_;
};

struct PictureSize {
  int width = 1200, height = 500;
  double scale = 1;  ///< pixels per unit: 2 gives a picture of twice the size, equally laid out
  bool dark = true;
};

/// The bytes of a PNG file. Error: what Cairo refuses (a size of 0 or above 32767).
[[nodiscard]] tl::expected<std::string, std::string> encode_png(const Image& image);

/// Error: the path and what to do about it.
[[nodiscard]] tl::expected<void, std::string> write_file(const std::filesystem::path& path, std::string_view bytes);
[[nodiscard]] tl::expected<void, std::string> write_png(const std::filesystem::path& path, const Image& image);

}  // namespace rustle::report
