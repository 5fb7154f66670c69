#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "server/scene/proximity.h"
#include "server/scene/triangles.h"
#include "server/sheet/mesh_frame.h"

/// Where and how much a sheet touches one partner, free of the mesh's resolution.
namespace rustle::analysis {

/// How much a place of the sheet counts as touching: 1 up to full_share of the contact radius, falling smoothly
/// (1 - 3x² + 2x³) to 0 at the radius. Inside a solid it is 1 down to penetration_m.
struct ContactWeight {
  double full_share = 0.85;
  double penetration_m = 0.02;

  double at(double distance_m, double radius_m) const;
};

/// A place on the sheet.
struct SheetSpot {
  std::uint32_t triangle;
  sheet::Vec3d barycentric;
};

/// The partner as seen from a point of the sheet.
struct Touch {
  double distance_m = 0;
  sheet::Vec3d normal = sheet::Vec3d::UnitZ();       ///< of the partner's surface
  sheet::Vec3d side_normal = sheet::Vec3d::UnitZ();  ///< the same, toward the side where the point is
  sheet::Vec3d velocity_m_per_s = sheet::Vec3d::Zero();
  bool velocity_known = true;
  std::uint32_t triangle = sheet::kNone;  ///< of the partner, if it has any
};

/// A triangle of the sheet with its corners.
struct SheetTriangle {
  std::uint32_t index;
  std::array<sheet::Vec3d, 3> corners_m;
};

/// Something that a sheet may touch, at one time. Used by one thread.
class ContactSurface {
 public:
  virtual ~ContactSurface() = default;

  /// Turns to a triangle: touch() is asked about places on it until the next call. False: surely no part of it is within
  /// the radius.
  virtual bool approach(const SheetTriangle& triangle, double radius_m) = 0;

  /// The partner within `radius_m` of a place, which is at most that of approach() plus range_beyond_m().
  virtual std::optional<Touch> touch(const sheet::Vec3d& point_m, const SheetSpot& spot, double radius_m) = 0;

  /// How far beyond the radius of approach() distances can be asked for.
  virtual double range_beyond_m() const { return 0; }
};

/// Velocity of every vertex, and of which it is known. [V] both, or empty: none is known.
struct VertexVelocities {
  std::vector<sheet::Vec3d> velocities_m_per_s;
  std::vector<bool> unknown;  ///< [V] or empty: all are known

  bool known(std::uint32_t vertex) const { return !velocities_m_per_s.empty() && (unknown.empty() || !unknown[vertex]); }
};

/// Contact of one sheet with one partner, by vertex.
struct ContactPatch {
  std::vector<std::uint32_t> vertices;           ///< that touch, ascending
  std::vector<double> areas_m2;                  ///< contact area of each
  std::vector<sheet::Vec3d> slips_m_per_s;       ///< tangential, relative to the partner
  std::vector<std::uint32_t> partner_triangles;  ///< one that each touches, or kNone
};

/// The frame's geometry, made once for all partners.
struct ContactGeometry {
  const sheet::MeshFrame* frame = nullptr;
  std::vector<sheet::Vec3f> cross_products_m2;  ///< [T], twice the area along the normal
  double usual_edge_m = 0;                      ///< of an equilateral triangle of the mean area
  scene::Box bounds_m;

  void update(const sheet::MeshFrame& mesh_frame);
};

/// Integrates the contact weight over the sheet: a triangle with all corners within reach by its corners, one partly within
/// reach by samples a fraction of the radius apart (at most 16 x 16), whose distance is interpolated where the partner is
/// one plane as seen from the corners and asked for elsewhere. Unknown velocities give no slip. O(T) plus the samples.
ContactPatch measure_contact(const ContactGeometry& geometry, ContactSurface& surface, const VertexVelocities& velocities,
                             const ContactWeight& weight, double radius_m);

/// An obstacle as a partner.
class ObstacleContact : public ContactSurface {
 public:
  /// `beyond_m` as range_beyond_m(); a plane is seen from any distance.
  ObstacleContact(const scene::ObstacleSurface& obstacle, double beyond_m) : obstacle_(obstacle), beyond_m_(beyond_m) {}
  bool approach(const SheetTriangle& triangle, double radius_m) override;
  std::optional<Touch> touch(const sheet::Vec3d& point_m, const SheetSpot& spot, double radius_m) override;
  double range_beyond_m() const override;

 private:
  const scene::ObstacleSurface& obstacle_;
  double beyond_m_;
};

/// How far apart places of one sheet are along its surface: by material coordinates, else along edges.
class SurfaceDistance {
 public:
  /// Places nearer than max(least_m, edges · local edge length) count as neighbours. Without material coordinates edge
  /// lengths are those of the rest positions, else of `positions_m`.
  SurfaceDistance(std::shared_ptr<const sheet::Topology> topology, std::span<const sheet::Vec3f> positions_m, double least_m,
                  double edges);

  const std::shared_ptr<const sheet::Topology>& topology() const { return topology_; }
  double least_m() const { return least_m_; }
  bool connected() const { return connected_; }  ///< in one piece

  bool neighbours(const SheetSpot& a, const SheetSpot& b);

  /// Turns to a triangle.
  void approach(std::uint32_t triangle);

  /// True: every place of `other` is a neighbour of every place of the triangle approached.
  bool wholly_neighbours(std::uint32_t other) const;

 private:
  sheet::Vec2d material_at(const SheetSpot& spot) const;
  const std::vector<std::uint32_t>& vertices_around(std::uint32_t vertex);
  const std::vector<std::uint32_t>& triangles_around(std::uint32_t triangle);

  std::shared_ptr<const sheet::Topology> topology_;
  double least_m_;
  bool connected_ = true;
  std::vector<double> exclusion_m_;     ///< [T]
  std::vector<sheet::Vec2d> centre_m_;  ///< [T], material
  std::vector<double> extent_m_;        ///< [T], from the centre to the farthest corner
  struct Link {
    std::uint32_t vertex;
    double length_m;
  };
  std::vector<std::uint32_t> link_start_;
  std::vector<Link> links_;
  std::vector<double> vertex_exclusion_m_;                    ///< [V], the greatest around
  std::vector<std::vector<std::uint32_t>> vertices_around_;   ///< [V], made when asked for
  std::vector<std::vector<std::uint32_t>> triangles_around_;  ///< [T], made when asked for
  std::vector<std::uint32_t> triangle_start_, triangles_of_vertex_;
  std::uint32_t approached_ = sheet::kNone;
  std::vector<std::uint32_t> marks_;  ///< [T]: wholly neighbours of the triangle marked
};

/// A sheet as a partner: another one, or the same one without what is near along its surface.
class SheetContact : public ContactSurface {
 public:
  /// `velocities` [V] or empty: at rest. `same_sheet` is null for another sheet.
  SheetContact(const sheet::Topology& topology, std::vector<sheet::Vec3f> positions_m, const VertexVelocities& velocities,
               double radius_m, SurfaceDistance* same_sheet);

  bool approach(const SheetTriangle& triangle, double radius_m) override;
  std::optional<Touch> touch(const sheet::Vec3d& point_m, const SheetSpot& spot, double radius_m) override;

  /// The closest place of the whole sheet.
  std::optional<Touch> closest(const sheet::Vec3d& point_m, double radius_m) const;

  std::size_t candidates_visited() const { return visited_; }  ///< so far: the broad phase's work

 private:
  const sheet::Topology& topology_;
  std::vector<sheet::Vec3f> positions_m_;
  const VertexVelocities& velocities_;
  SurfaceDistance* same_sheet_;
  scene::TriangleGrid grid_;
  struct Candidate {
    std::uint32_t triangle;
    std::array<sheet::Vec3d, 3> corners_m;
    sheet::Vec3d normal = sheet::Vec3d::Zero();  ///< unit length
    sheet::Vec3d centre_m = sheet::Vec3d::Zero();
    double extent_m = 0;  ///< of the corners from the centre
  };
  static void complete(Candidate& candidate);
  Touch touch_at(const sheet::Vec3d& point_m, const Candidate& candidate, const scene::TrianglePoint& on) const;
  Candidate candidate(std::uint32_t triangle) const;

  std::vector<Candidate> candidates_;  ///< of the triangle approached
  std::size_t visited_ = 0;
};

/// True: no two parts of the sheet lie on top of each other. Then all normals are within 84° of their mean, and the border
/// seen along it does not cross itself. Conservative. O(T + B log B + crossings in x). \pre the sheet is in one piece
bool surely_unfolded(const ContactGeometry& geometry);

}  // namespace rustle::analysis
