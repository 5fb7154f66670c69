#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>

#include "client_sdk/sheets/rectangle.h"
#include "client_sdk/sheets/shape.h"

namespace rustle::sheets {

/// A sheet whose positions are a pure function of time. Methods may be called from several threads at once.
class AnimatedSheet {
 public:
  virtual ~AnimatedSheet() = default;
  virtual const SheetMesh& mesh() const = 0;
  virtual double duration_s() const = 0;

  /// x, y, z of every vertex. Before 0 and after duration_s() the sheet is as at those times.
  /// \pre xyz_m.size() == 3 mesh().material_coordinates.size()
  virtual void positions(double time_s, std::span<float> xyz_m) const = 0;

  /// 1 where a vertex is held at that time, else 0. \pre mask.size() == mesh().material_coordinates.size()
  virtual void anchored(double time_s, std::span<std::uint8_t> mask) const = 0;

  /// Whether a table, solid below z = 0, belongs to it.
  virtual bool on_table() const = 0;
};

/// Where every material point (u, v) is at one time.
using MaterialMap = std::function<Point3(double u_m, double v_m)>;

/// What makes a procedural sheet.
struct Animation {
  double duration_s = 0;
  bool on_table = false;
  std::function<MaterialMap(double time_s)> map_at;
  std::function<bool(double time_s, double u_m, double v_m)> is_held;  ///< empty: nothing is held
};

[[nodiscard]] std::unique_ptr<AnimatedSheet> make_animated(SheetMesh mesh, Animation animation);

/// 0 before 0, 1 after 1, between them 6x⁵ - 15x⁴ + 10x³; ½ at ½, two continuous derivatives.
[[nodiscard]] double smooth_step(double x);

}  // namespace rustle::sheets
