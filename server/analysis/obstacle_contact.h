#pragma once

#include <vector>

#include "server/analysis/contact_patch.h"
#include "server/scene/proximity.h"

namespace rustle::analysis {

/// An obstacle as a partner. Keeps working memory; set() turns it to an obstacle.
class ObstacleContact : public ContactSurface {
 public:
  /// The obstacle outlives what follows.
  void set(const scene::ObstacleSurface& obstacle);

  /// By distances of vertices from a plane, else by the triangles' boxes in the obstacle's own frame.
  void select(const ContactGeometry& geometry, double radius_m, std::vector<std::uint32_t>& out_triangles) override;
  bool touch(const sheet::Vec3d& point_m, const SheetSpot& spot, double radius_m, Touch& out) override;
  double range_beyond_m() const override { return usual_edge_m_; }
  const ContactPlane* plane() const override { return obstacle_->is_plane() ? &plane_ : nullptr; }

 private:
  void select_by_distance(const ContactGeometry& geometry, double radius_m, std::vector<std::uint32_t>& out_triangles);
  void select_by_box(const ContactGeometry& geometry, double radius_m, std::vector<std::uint32_t>& out_triangles);

  const scene::ObstacleSurface* obstacle_ = nullptr;
  ContactPlane plane_;
  double usual_edge_m_ = 0;  ///< of an equilateral triangle of the selected ones' mean area
  std::vector<float> distances_m_;
  std::vector<Eigen::Vector4f> own_m_;
};

}  // namespace rustle::analysis
