#include "server/analysis/sheet_motion.h"

namespace rustle::analysis {
namespace {

using scene::Box;
using sheet::Topology;
using sheet::Triangle;
using sheet::Vec3d;
using sheet::Vec3f;

/// Finds material points in a mesh.
class MaterialLocator {
 public:
  explicit MaterialLocator(const Topology& topology) : topology_(topology) {
    const auto material = topology.material_coordinates_m();
    flat_m_.reserve(material.size());
    for (const auto& m : material) flat_m_.emplace_back(m.x(), m.y(), 0.0f);
    double extent_m = 0;
    for (const Triangle& t : topology.triangles()) extent_m += scene::triangle_box(t, flat_m_).sizes().maxCoeff();
    cell_m_ = topology.triangle_count() > 0 ? extent_m / static_cast<double>(topology.triangle_count()) : 0.0;
    if (cell_m_ > 0) grid_.build(topology.triangles(), flat_m_, cell_m_);
  }

  /// Where the material point is in `positions_m`; none when it lies outside the mesh.
  std::optional<Vec3d> find(const sheet::Vec2f& material_m, std::span<const Vec3f> positions_m) const {
    if (!(cell_m_ > 0)) return std::nullopt;
    const Vec3d query(static_cast<double>(material_m.x()), static_cast<double>(material_m.y()), 0.0);
    const double tolerance_m = 0.05 * cell_m_;
    double best2 = tolerance_m * tolerance_m;
    std::optional<Vec3d> best;
    const Vec3d reach = Vec3d::Constant(tolerance_m);
    grid_.visit_box(Box(Vec3d(query - reach), Vec3d(query + reach)), [&](std::uint32_t t) {
      const Triangle& v = topology_.triangles()[t];
      const scene::TrianglePoint on = scene::closest_on_triangle(query, flat_m_[v[0]].cast<double>(),
                                                                 flat_m_[v[1]].cast<double>(), flat_m_[v[2]].cast<double>());
      const double distance2 = (query - on.position_m).squaredNorm();
      if (distance2 > best2 || (best && distance2 == best2)) return true;
      best2 = distance2;
      best = on.barycentric[0] * positions_m[v[0]].cast<double>() + on.barycentric[1] * positions_m[v[1]].cast<double>() +
             on.barycentric[2] * positions_m[v[2]].cast<double>();
      return true;
    });
    return best;
  }

 private:
  const Topology& topology_;
  std::vector<Vec3f> flat_m_;
  double cell_m_ = 0;
  scene::TriangleGrid grid_;
};

}  // namespace

bool follows(const sheet::MeshFrame& frame, const sheet::MeshFrame* previous) {
  return previous && frame.time_s > previous->time_s && previous->positions_m.size() == frame.positions_m.size() &&
         previous->topology == frame.topology;
}

void locate_velocities(const sheet::MeshFrame& frame, const sheet::MeshFrame& before, double interval_s,
                       std::vector<std::optional<Vec3d>>& out_m_per_s) {
  const auto material = frame.topology->material_coordinates_m();
  out_m_per_s.assign(frame.positions_m.size(), std::nullopt);
  if (material.empty() || before.topology->material_coordinates_m().empty()) return;
  const MaterialLocator locator(*before.topology);
  for (std::size_t i = 0; i < material.size(); ++i) {
    const auto place_m = locator.find(material[i], before.positions_m);
    if (place_m) out_m_per_s[i] = (frame.positions_m[i].cast<double>() - *place_m) / interval_s;
  }
}

}  // namespace rustle::analysis
