#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tl/expected.hpp>

#include "rustle/v1/sheet.pb.h"
#include "server/session/session_options.h"
#include "server/sheet/topology.h"
#include "server/sheet/vector.h"
#include "server/wire/error.h"
#include "server/wire/limits.h"

/// Checks and conversions of single fields. Payloads are little-endian and may be unaligned: they are copied, never cast.
namespace rustle::wire {

/// From the sender's units and axes to metres, z up: scaled, and (x, y, z) -> (x, -z, y) where the sender has y up.
/// A proper rotation, so orientations of triangles stay.
struct Conversion {
  double metres_per_unit = 1;
  bool y_up = false;

  static Conversion of(const session::SessionOptions& options) {
    return {options.metres_per_unit, options.up_axis == session::UpAxis::kY};
  }
  sheet::Vec3d turn(const sheet::Vec3d& v) const { return y_up ? sheet::Vec3d(v.x(), -v.z(), v.y()) : v; }
  sheet::Vec3d turn_back(const sheet::Vec3d& v) const { return y_up ? sheet::Vec3d(v.x(), v.z(), -v.y()) : v; }
};

[[nodiscard]] tl::unexpected<Error> refuse(ErrorCode code, std::string_view field, std::string message, std::string remedy);

/// Protobuf prints what it cannot parse; here that becomes an error for the sender, and nobody may fill the log.
void keep_protobuf_quiet();

/// How an array's entries are bounded and named in errors.
struct ArrayField {
  std::string_view field;       ///< "frame.positions"
  std::string_view item;        ///< "vertex"
  double limit;                 ///< |component| after conversion
  std::string_view limit_unit;  ///< "m"
};

/// `bytes` must be `count` rows of `row_bytes`.
[[nodiscard]] tl::expected<void, Error> check_size(const std::string& bytes, std::size_t count, std::size_t row_bytes,
                                                   std::string_view field, std::string_view counted);

/// The number of whole rows, at most `limit`.
[[nodiscard]] tl::expected<std::size_t, Error> count_rows(const std::string& bytes, std::size_t row_bytes, std::size_t limit,
                                                          std::string_view field);

/// f32 [count,3]; the caller has checked the size.
[[nodiscard]] tl::expected<std::vector<sheet::Vec3f>, Error> read_points(const std::string& bytes, double scale, bool y_up,
                                                                         const ArrayField& about);
/// f32 [count,2], scaled.
[[nodiscard]] tl::expected<std::vector<sheet::Vec2f>, Error> read_points_2d(const std::string& bytes, double scale,
                                                                            const ArrayField& about);
/// f32 [count] in [0, limit].
[[nodiscard]] tl::expected<std::vector<float>, Error> read_magnitudes(const std::string& bytes, const ArrayField& about);

/// u32 [count], each below `bound` (or `none` where `none_allowed`).
[[nodiscard]] tl::expected<std::vector<std::uint32_t>, Error> read_indices(const std::string& bytes, std::size_t bound,
                                                                           bool none_allowed, std::string_view field,
                                                                           std::string_view item, std::string_view counted);

/// u32 [T,3], indices below vertex_count.
[[nodiscard]] tl::expected<std::vector<sheet::Triangle>, Error> read_triangles(const std::string& bytes,
                                                                               std::size_t vertex_count, std::size_t limit,
                                                                               std::string_view field);

[[nodiscard]] tl::expected<void, Error> check_text(const std::string& text, std::string_view field, const Limits& limits);
[[nodiscard]] tl::expected<void, Error> check_time(double time_s, std::string_view field, const Limits& limits);

/// Finite and in [low, high].
[[nodiscard]] tl::expected<void, Error> check_range(double value, double low, double high, std::string_view field,
                                                    std::string_view unit);

/// A point or vector, scaled and turned, each component finite and within ±limit.
[[nodiscard]] tl::expected<sheet::Vec3d, Error> read_vector(const v1::Vector3& vector, double scale, bool y_up, double limit,
                                                            std::string_view field, std::string_view unit);

/// A direction of unit length, turned; zero where the sender's is zero.
[[nodiscard]] tl::expected<sheet::Vec3d, Error> read_direction(const v1::Vector3& vector, bool y_up, std::string_view field);

inline void to_wire(const sheet::Vec3d& v, v1::Vector3* out) {
  out->set_x(v.x());
  out->set_y(v.y());
  out->set_z(v.z());
}

}  // namespace rustle::wire
