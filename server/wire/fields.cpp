#include "server/wire/fields.h"

#include <bit>
#include <cassert>
#include <cmath>
#include <cstring>

#include <fmt/format.h>

static_assert(std::endian::native == std::endian::little, "payloads are copied as they come: little-endian");

namespace rustle::wire {

using sheet::Vec2f;
using sheet::Vec3d;
using sheet::Vec3f;

static_assert(sizeof(Vec3f) == 3 * sizeof(float) && sizeof(Vec2f) == 2 * sizeof(float));

namespace {

float float_at(const std::string& bytes, std::size_t index) {
  float value;
  std::memcpy(&value, bytes.data() + index * sizeof(float), sizeof(float));
  return value;
}

/// True where every value is a number within ±limit: NaN fails the comparison too.
bool all_within(std::span<const float> values, float limit) {
  bool good = true;
  for (const float value : values) good &= std::abs(value) <= limit;
  return good;
}

/// Names the first value that all_within() found.
tl::unexpected<Error> refuse_value(const std::string& bytes, std::span<const float> values, std::size_t columns, float limit,
                                   const ArrayField& about) {
  for (std::size_t i = 0; i < values.size(); ++i) {
    const float sent = float_at(bytes, i);
    if (!std::isfinite(sent))
      return refuse(ErrorCode::kNotFinite, about.field,
                    fmt::format("{} {} of {} has a component that is {}.", about.item, i / columns, about.field, sent),
                    "Stop the simulation where it becomes unstable, or leave this message out.");
  }
  for (std::size_t i = 0; i < values.size(); ++i)
    if (!(std::abs(values[i]) <= limit))
      return refuse(ErrorCode::kOutOfRange, about.field,
                    fmt::format("{} {} of {} has a component of {} {}, beyond {}.", about.item, i / columns, about.field,
                                values[i], about.limit_unit, about.limit),
                    "Check metres_per_unit, and send coordinates near the origin.");
  assert(false && "refuse_value is called where a value is out of range");
  return refuse(ErrorCode::kOutOfRange, about.field, "A value is out of range.", "");
}

}  // namespace

void keep_protobuf_quiet() {
  static const auto previous = google::protobuf::SetLogHandler(nullptr);
  static_cast<void>(previous);
}

tl::unexpected<Error> refuse(ErrorCode code, std::string_view field, std::string message, std::string remedy) {
  return tl::unexpected(Error{.code = code,
                              .field = std::string(field),
                              .message = std::move(message),
                              .remedy = std::move(remedy),
                              .sequence = 0,
                              .quota = {},
                              .permission = {}});
}

tl::expected<void, Error> check_size(const std::string& bytes, std::size_t count, std::size_t row_bytes,
                                     std::string_view field, std::string_view counted) {
  if (bytes.size() == count * row_bytes) return {};
  return refuse(ErrorCode::kMalformed, field,
                fmt::format("{} has {} bytes; {} {} of {} bytes each make {}.", field, bytes.size(), count, counted,
                            row_bytes, count * row_bytes),
                "Send one row for each, little-endian and without padding.");
}

tl::expected<std::size_t, Error> count_rows(const std::string& bytes, std::size_t row_bytes, std::size_t limit,
                                            std::string_view field) {
  if (bytes.size() % row_bytes != 0)
    return refuse(ErrorCode::kMalformed, field,
                  fmt::format("{} has {} bytes, which is no multiple of {}.", field, bytes.size(), row_bytes),
                  "Send whole rows, little-endian and without padding.");
  const std::size_t count = bytes.size() / row_bytes;
  if (count > limit)
    return refuse(ErrorCode::kTooLarge, field, fmt::format("{} has {} rows; at most {} are taken.", field, count, limit),
                  "Send a coarser mesh, or several smaller ones.");
  return count;
}

tl::expected<std::vector<Vec3f>, Error> read_points(const std::string& bytes, double scale, bool y_up,
                                                    const ArrayField& about) {
  const std::size_t count = bytes.size() / sizeof(Vec3f);
  std::vector<Vec3f> points(count);
  if (count == 0) return points;
  const std::span<float> values(points.front().data(), 3 * count);
  std::memcpy(values.data(), bytes.data(), values.size_bytes());
  if (scale != 1) {
    const auto factor = static_cast<float>(scale);
    for (float& value : values) value *= factor;
  }
  if (y_up)
    for (Vec3f& point : points) point = Vec3f(point.x(), -point.z(), point.y());
  const auto limit = static_cast<float>(about.limit);
  if (!all_within(values, limit)) return refuse_value(bytes, values, 3, limit, about);
  return points;
}

tl::expected<std::vector<Vec2f>, Error> read_points_2d(const std::string& bytes, double scale, const ArrayField& about) {
  const std::size_t count = bytes.size() / sizeof(Vec2f);
  std::vector<Vec2f> points(count);
  if (count == 0) return points;
  const std::span<float> values(points.front().data(), 2 * count);
  std::memcpy(values.data(), bytes.data(), values.size_bytes());
  const auto factor = static_cast<float>(scale);
  for (float& value : values) value *= factor;
  const auto limit = static_cast<float>(about.limit);
  if (!all_within(values, limit)) return refuse_value(bytes, values, 2, limit, about);
  return points;
}

tl::expected<std::vector<float>, Error> read_magnitudes(const std::string& bytes, const ArrayField& about) {
  std::vector<float> values(bytes.size() / sizeof(float));
  if (values.empty()) return values;
  std::memcpy(values.data(), bytes.data(), values.size() * sizeof(float));
  const auto limit = static_cast<float>(about.limit);
  if (!all_within(values, limit)) return refuse_value(bytes, values, 1, limit, about);
  for (std::size_t i = 0; i < values.size(); ++i)
    if (values[i] < 0)
      return refuse(ErrorCode::kOutOfRange, about.field,
                    fmt::format("{} {} of {} is {}, below 0.", about.item, i, about.field, values[i]),
                    "Send magnitudes: 0 or more.");
  return values;
}

tl::expected<std::vector<std::uint32_t>, Error> read_indices(const std::string& bytes, std::size_t bound, bool none_allowed,
                                                             std::string_view field, std::string_view item,
                                                             std::string_view counted) {
  std::vector<std::uint32_t> indices(bytes.size() / sizeof(std::uint32_t));
  if (indices.empty()) return indices;
  std::memcpy(indices.data(), bytes.data(), indices.size() * sizeof(std::uint32_t));
  for (std::size_t i = 0; i < indices.size(); ++i)
    if (indices[i] >= bound && !(none_allowed && indices[i] == sheet::kNone))
      return refuse(ErrorCode::kOutOfRange, field,
                    fmt::format("{} {} of {} is {}, but there are {} {}.", item, i, field, indices[i], bound, counted),
                    "Count from 0.");
  return indices;
}

tl::expected<std::vector<sheet::Triangle>, Error> read_triangles(const std::string& bytes, std::size_t vertex_count,
                                                                 std::size_t limit, std::string_view field) {
  const auto count = count_rows(bytes, sizeof(sheet::Triangle), limit, field);
  if (!count) return tl::unexpected(count.error());
  std::vector<sheet::Triangle> triangles(*count);
  if (triangles.empty()) return triangles;
  std::memcpy(triangles.data(), bytes.data(), bytes.size());
  for (std::size_t t = 0; t < triangles.size(); ++t)
    for (const std::uint32_t vertex : triangles[t])
      if (vertex >= vertex_count)
        return refuse(
            ErrorCode::kOutOfRange, field,
            fmt::format("Triangle {} of {} names vertex {}, but there are {} vertices.", t, field, vertex, vertex_count),
            "Count vertices from 0, and send unsigned 32-bit indices.");
  return triangles;
}

tl::expected<void, Error> check_text(const std::string& text, std::string_view field, const Limits& limits) {
  if (text.size() > limits.string_bytes)
    return refuse(ErrorCode::kTooLarge, field,
                  fmt::format("{} has {} bytes; at most {} are taken.", field, text.size(), limits.string_bytes),
                  "Send a shorter text.");
  for (const char c : text)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f)
      return refuse(ErrorCode::kMalformed, field, fmt::format("{} holds a control character.", field),
                    "Send printable text.");
  return {};
}

tl::expected<void, Error> check_range(double value, double low, double high, std::string_view field, std::string_view unit) {
  if (!std::isfinite(value))
    return refuse(ErrorCode::kNotFinite, field, fmt::format("{} is {}.", field, value), "Send a finite number.");
  if (value < low || value > high)
    return refuse(ErrorCode::kOutOfRange, field,
                  fmt::format("{} is {}{}{}, outside {} to {}.", field, value, unit.empty() ? "" : " ", unit, low, high),
                  "Send a value in this range; check the units.");
  return {};
}

tl::expected<void, Error> check_time(double time_s, std::string_view field, const Limits& limits) {
  return check_range(time_s, -limits.time_s, limits.time_s, field, "s");
}

tl::expected<Vec3d, Error> read_vector(const v1::Vector3& vector, double scale, bool y_up, double limit,
                                       std::string_view field, std::string_view unit) {
  const Vec3d scaled = Vec3d(vector.x(), vector.y(), vector.z()) * scale;
  for (const double component : {vector.x(), vector.y(), vector.z()})
    if (const auto good = check_range(component * scale, -limit, limit, field, unit); !good)
      return tl::unexpected(good.error());
  return Conversion{.metres_per_unit = 1, .y_up = y_up}.turn(scaled);
}

tl::expected<Vec3d, Error> read_direction(const v1::Vector3& vector, bool y_up, std::string_view field) {
  const auto read = read_vector(vector, 1, y_up, 1e30, field, "");
  if (!read) return read;
  const double length = read->stableNorm();
  if (length < 1e-30) return Vec3d(Vec3d::Zero());
  return Vec3d((*read / length).normalized());
}

}  // namespace rustle::wire
