#include "server/report/image_canvas.h"

#include <array>
#include <cassert>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <numbers>
#include <system_error>

#include <cairo.h>
#include <fmt/format.h>

namespace rustle::report {
namespace {

constexpr double kThin = 1;  ///< up to this width straight lines go to pixel middles

struct SurfaceDeleter {
  void operator()(cairo_surface_t* surface) const { cairo_surface_destroy(surface); }
};
using SurfacePtr = std::unique_ptr<cairo_surface_t, SurfaceDeleter>;

/// A Cairo surface with a copy of the pixels; rows are padded as Cairo wants them.
SurfacePtr surface_of(const Image& image) {
  SurfacePtr surface(cairo_image_surface_create(CAIRO_FORMAT_RGB24, image.width, image.height));
  if (cairo_surface_status(surface.get()) != CAIRO_STATUS_SUCCESS) return surface;
  unsigned char* const rows = cairo_image_surface_get_data(surface.get());
  const std::size_t stride = static_cast<std::size_t>(cairo_image_surface_get_stride(surface.get()));
  const std::size_t width = static_cast<std::size_t>(image.width);
  for (std::size_t y = 0; y < static_cast<std::size_t>(image.height); ++y) {
    std::memcpy(rows + y * stride, image.pixels.data() + y * width, width * sizeof(std::uint32_t));
  }
  cairo_surface_mark_dirty(surface.get());
  return surface;
}

cairo_status_t append(void* closure, const unsigned char* data, unsigned int length) {
  auto* const bytes = static_cast<std::string*>(closure);
  bytes->append(reinterpret_cast<const char*>(data), length);
  return CAIRO_STATUS_SUCCESS;
}

}  // namespace

struct ImageCanvas::Surface {
  double width, height, scale;
  Theme theme;
  SurfacePtr target;
  cairo_t* context;

  void use(const Paint& paint) const {
    /// Rounded as pixel_of rounds; Cairo by itself cuts off.
    const std::uint32_t pixel = pixel_of(paint.themed ? theme[static_cast<std::size_t>(paint.ink)] : paint.colour);
    const auto part = [pixel](int shift) { return ((pixel >> shift) & 0xff) / 255.0; };
    cairo_set_source_rgba(context, part(16), part(8), part(0), paint.alpha);
  }
  void stroke(const Stroke& stroke) const {
    use(stroke.paint);
    cairo_set_line_width(context, stroke.width);
    const std::array<double, 2> dashes = {5, 4};
    cairo_set_dash(context, dashes.data(), stroke.dashed ? 2 : 0, 0);
    cairo_stroke(context);
  }
  /// The middle of the pixel a coordinate falls in, where thin upright and level lines are sharp.
  double middle(double coordinate) const { return (std::floor(coordinate * scale) + 0.5) / scale; }
  void path(std::span<const Point> points) const {
    cairo_new_path(context);
    for (const Point& p : points) cairo_line_to(context, p.x, p.y);
  }
};

ImageCanvas::ImageCanvas(int width, int height, const Theme& theme, double scale) {
  assert(width >= 1 && height >= 1 && scale > 0 && scale <= 4);
  const int columns = std::max(1, static_cast<int>(width * scale)), rows = std::max(1, static_cast<int>(height * scale));
  assert(columns <= 16384 && rows <= 16384);
  SurfacePtr target(cairo_image_surface_create(CAIRO_FORMAT_RGB24, columns, rows));
  cairo_t* const context = cairo_create(target.get());
  cairo_scale(context, scale, scale);
  cairo_set_line_join(context, CAIRO_LINE_JOIN_ROUND);
  surface_ = std::make_unique<Surface>(
      Surface{static_cast<double>(width), static_cast<double>(height), scale, theme, std::move(target), context});
  rectangle({0, 0, surface_->width, surface_->height}, Ink::kBackground);
}

ImageCanvas::~ImageCanvas() {
  cairo_destroy(surface_->context);
}

double ImageCanvas::width() const {
  return surface_->width;
}
double ImageCanvas::height() const {
  return surface_->height;
}

void ImageCanvas::rectangle(const Rect& rect, const Paint& fill) {
  surface_->use(fill);
  cairo_new_path(surface_->context);
  cairo_rectangle(surface_->context, rect.x, rect.y, rect.width, rect.height);
  cairo_fill(surface_->context);
}

void ImageCanvas::polyline(std::span<const Point> points, const Stroke& stroke) {
  bool straight = stroke.width <= kThin;
  for (std::size_t i = 1; i < points.size(); ++i) {
    straight = straight && (points[i].x == points[i - 1].x || points[i].y == points[i - 1].y);
  }
  if (!straight) {
    surface_->path(points);
  } else {
    std::vector<Point> sharp;
    for (const Point& p : points) sharp.push_back({surface_->middle(p.x), surface_->middle(p.y)});
    surface_->path(sharp);
  }
  surface_->stroke(stroke);
}

void ImageCanvas::segments(std::span<const std::pair<Point, Point>> lines, const Stroke& stroke) {
  cairo_new_path(surface_->context);
  for (auto [from, to] : lines) {
    if (stroke.width <= kThin && from.x == to.x) from.x = to.x = surface_->middle(from.x);
    if (stroke.width <= kThin && from.y == to.y) from.y = to.y = surface_->middle(from.y);
    cairo_move_to(surface_->context, from.x, from.y);
    cairo_line_to(surface_->context, to.x, to.y);
  }
  surface_->stroke(stroke);
}

void ImageCanvas::polygon(std::span<const Point> points, const Paint& fill) {
  surface_->path(points);
  cairo_close_path(surface_->context);
  surface_->use(fill);
  cairo_fill(surface_->context);
}

void ImageCanvas::disc(const Point& centre, double radius, const Paint& fill) {
  cairo_new_path(surface_->context);
  cairo_arc(surface_->context, centre.x, centre.y, radius, 0, 2 * std::numbers::pi);
  surface_->use(fill);
  cairo_fill(surface_->context);
}

void ImageCanvas::circle(const Point& centre, double radius, const Stroke& stroke) {
  cairo_new_path(surface_->context);
  cairo_arc(surface_->context, centre.x, centre.y, radius, 0, 2 * std::numbers::pi);
  surface_->stroke(stroke);
}

void ImageCanvas::text(const Point& position, std::string_view text, const TextStyle& style) {
  cairo_t* const context = surface_->context;
  const std::string terminated(text);
  cairo_save(context);
  cairo_select_font_face(context, "sans-serif", CAIRO_FONT_SLANT_NORMAL,
                         style.bold ? CAIRO_FONT_WEIGHT_BOLD : CAIRO_FONT_WEIGHT_NORMAL);
  cairo_set_font_size(context, style.size);
  cairo_text_extents_t extents;
  cairo_text_extents(context, terminated.c_str(), &extents);
  cairo_translate(context, position.x, position.y);
  if (style.upward) cairo_rotate(context, -std::numbers::pi / 2);
  const double shift = style.align == Align::kLeft ? 0 : style.align == Align::kCentre ? 0.5 : 1;
  cairo_move_to(context, -shift * extents.x_advance, 0);
  surface_->use(style.paint);
  cairo_show_text(context, terminated.c_str());
  cairo_restore(context);
}

void ImageCanvas::image(const Rect& rect, const Image& image) {
  if (image.width < 1 || image.height < 1) return;
  const SurfacePtr source = surface_of(image);
  cairo_t* const context = surface_->context;
  cairo_save(context);
  cairo_translate(context, rect.x, rect.y);
  cairo_scale(context, rect.width / image.width, rect.height / image.height);
  cairo_set_source_surface(context, source.get(), 0, 0);
  cairo_pattern_set_extend(cairo_get_source(context), CAIRO_EXTEND_PAD);
  cairo_rectangle(context, 0, 0, image.width, image.height);
  cairo_fill(context);
  cairo_restore(context);
}

void ImageCanvas::clip(const Rect& rect) {
  cairo_save(surface_->context);
  cairo_new_path(surface_->context);
  cairo_rectangle(surface_->context, rect.x, rect.y, rect.width, rect.height);
  cairo_clip(surface_->context);
}

void ImageCanvas::unclip() {
  cairo_restore(surface_->context);
}

Image ImageCanvas::pixels() const {
  cairo_surface_t* const target = surface_->target.get();
  cairo_surface_flush(target);
  Image image{cairo_image_surface_get_width(target), cairo_image_surface_get_height(target), {}};
  const unsigned char* const rows = cairo_image_surface_get_data(target);
  const std::size_t stride = static_cast<std::size_t>(cairo_image_surface_get_stride(target));
  const std::size_t width = static_cast<std::size_t>(image.width);
  image.pixels.resize(width * static_cast<std::size_t>(image.height));
  if (rows == nullptr) return image;
  for (std::size_t y = 0; y < static_cast<std::size_t>(image.height); ++y) {
    std::memcpy(image.pixels.data() + y * width, rows + y * stride, width * sizeof(std::uint32_t));
  }
  for (std::uint32_t& pixel : image.pixels) pixel &= 0xffffffu;
  return image;
}

tl::expected<std::string, std::string> encode_png(const Image& image) {
  assert(image.pixels.size() == static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height));
  const SurfacePtr surface = surface_of(image);
  std::string bytes;
  cairo_status_t status = cairo_surface_status(surface.get());
  if (status == CAIRO_STATUS_SUCCESS) status = cairo_surface_write_to_png_stream(surface.get(), append, &bytes);
  if (status != CAIRO_STATUS_SUCCESS) {
    return tl::unexpected(
        fmt::format("picture of {} x {} pixels: {}", image.width, image.height, cairo_status_to_string(status)));
  }
  return bytes;
}

tl::expected<void, std::string> write_file(const std::filesystem::path& path, std::string_view bytes) {
  errno = 0;
  std::ofstream file(path, std::ios::binary | std::ios::trunc);
  file.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  file.close();
  if (!file) {
    const int code = errno;
    return tl::unexpected(
        fmt::format("{}: cannot be written ({}); name a file in a folder that exists, is writable and has room",
                    path.string(), code != 0 ? std::generic_category().message(code) : "write failed"));
  }
  return {};
}

tl::expected<void, std::string> write_png(const std::filesystem::path& path, const Image& image) {
  const auto bytes = encode_png(image);
  if (!bytes) return tl::unexpected(fmt::format("{}: {}", path.string(), bytes.error()));
  return write_file(path, *bytes);
}

}  // namespace rustle::report
