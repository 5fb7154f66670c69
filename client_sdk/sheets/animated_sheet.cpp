#include "client_sdk/sheets/animated_sheet.h"

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <utility>

namespace rustle::sheets {
namespace {

class MappedSheet : public AnimatedSheet {
 public:
  MappedSheet(SheetMesh mesh, Animation animation) : mesh_(std::move(mesh)), animation_(std::move(animation)) {}

  const SheetMesh& mesh() const override { return mesh_; }
  double duration_s() const override { return animation_.duration_s; }
  bool on_table() const override { return animation_.on_table; }

  void positions(double time_s, std::span<float> xyz_m) const override {
    const auto& uv = mesh_.material_coordinates;
    assert(xyz_m.size() == 3 * uv.size());
    const MaterialMap map = animation_.map_at(within(time_s));
    for (std::size_t i = 0; i < uv.size(); ++i) {
      const Point3 point = map(static_cast<double>(uv[i][0]), static_cast<double>(uv[i][1]));
      for (std::size_t k = 0; k < 3; ++k) xyz_m[3 * i + k] = static_cast<float>(point[k]);
    }
  }

  void anchored(double time_s, std::span<std::uint8_t> mask) const override {
    const auto& uv = mesh_.material_coordinates;
    assert(mask.size() == uv.size());
    for (std::size_t i = 0; i < uv.size(); ++i) {
      mask[i] = animation_.is_held &&
                        animation_.is_held(within(time_s), static_cast<double>(uv[i][0]), static_cast<double>(uv[i][1]))
                    ? 1
                    : 0;
    }
  }

 private:
  double within(double time_s) const { return std::clamp(time_s, 0.0, animation_.duration_s); }

  SheetMesh mesh_;
  Animation animation_;
};

}  // namespace

std::unique_ptr<AnimatedSheet> make_animated(SheetMesh mesh, Animation animation) {
  return std::make_unique<MappedSheet>(std::move(mesh), std::move(animation));
}

double smooth_step(double x) {
  const double y = std::clamp(x, 0.0, 1.0);
  return y * y * y * (10 + y * (6 * y - 15));
}

}  // namespace rustle::sheets
