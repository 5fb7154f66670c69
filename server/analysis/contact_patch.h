#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "server/analysis/plane_batch.h"
#include "server/analysis/sheet_motion.h"
#include "server/scene/scene_state.h"
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

/// The frame's geometry, made once for all partners.
struct ContactGeometry {
  const sheet::MeshFrame* frame = nullptr;
  sheet::Vec3f origin_m = sheet::Vec3f::Zero();
  std::span<const Eigen::Vector4f> relative_m;  ///< [V], positions from the origin, 0 last; they outlive what is asked here
  scene::Box bounds_m;

  /// \pre sheet::relative_positions_m(mesh_frame.positions_m, origin, relative)
  void update(const sheet::MeshFrame& mesh_frame, const sheet::Vec3f& origin, std::span<const Eigen::Vector4f> relative);

  /// How far off float arithmetic on `relative_m` can be, generously.
  float rounding_m() const;
};

/// One infinite plane: distances are linear over every triangle.
struct ContactPlane {
  sheet::Vec3d position_m = sheet::Vec3d::Zero(), normal = sheet::Vec3d::UnitZ();
  scene::RigidMotion motion;
};

/// Something that a sheet may touch, at one time. Used by one thread.
class ContactSurface {
 public:
  virtual ~ContactSurface() = default;

  /// The sheet's triangles that may lie within the radius in part, ascending. Of all others surely no part does.
  virtual void select(const ContactGeometry& geometry, double radius_m, std::vector<std::uint32_t>& out_triangles) = 0;

  /// Turns to a selected triangle: touch() is asked about places on it until the next call.
  virtual void approach(std::uint32_t) {}

  /// On a second look at the triangle approached, none of whose corners is within the radius: surely no part of it is.
  virtual bool surely_apart(std::uint32_t, double) { return false; }

  /// The plane that it is, or null. What follows is asked of others only.
  virtual const ContactPlane* plane() const { return nullptr; }

  /// The partner within `radius_m` of a place, which is at most that of select() plus range_beyond_m(); false: none.
  virtual bool touch(const sheet::Vec3d& point_m, const SheetSpot& spot, double radius_m, Touch& out) = 0;

  /// How far beyond the radius of select() distances can be asked for, known once that has been called.
  virtual double range_beyond_m() const { return 0; }
};

/// Contact of one sheet with one partner, by vertex.
struct ContactPatch {
  std::vector<std::uint32_t> vertices;           ///< that touch, ascending
  std::vector<double> areas_m2;                  ///< contact area of each
  std::vector<sheet::Vec3d> slips_m_per_s;       ///< tangential, relative to the partner
  std::vector<std::uint32_t> partner_triangles;  ///< one that each touches, or kNone
  std::vector<std::uint32_t> triangles;          ///< ascending, with all that lie around the vertices

  void clear();
};

/// Integrates the contact weight over the sheet. A triangle whose corners are all touched in full counts by them. Where the
/// partner is one plane as seen from a triangle's corners the distance is linear over it (PlaneBatch). Other triangles count
/// by their corners when these are all within reach, else by samples a radius apart (at most 16 x 16). Unknown velocities
/// give no slip.
/// Keeps its working memory: once warm nothing is allocated. Cost: that of select(), O(V) and the selected triangles.
class ContactMeter {
 public:
  /// The result stands until the next call. \pre radius_m > 0
  const ContactPatch& measure(const ContactGeometry& geometry, ContactSurface& surface, const VertexVelocities& velocities,
                              const ContactWeight& weight, double radius_m);

 private:
  struct Corner {
    sheet::Vec4f slip_m_per_s = sheet::Vec4f::Zero();  ///< zero unless known
    float weight = 0;
    float distance_m = 0;
    bool touched = false;
    bool slip_known = false;
    std::uint32_t vertex = 0;
    std::uint32_t partner_triangle = sheet::kNone;  ///< that the corner touches, or kNone
    double lumped_m2 = 0;                           ///< contact area of triangles that lie within reach entirely
    // Of other triangles:
    double area_m2 = 0;
    Eigen::Vector4d moved = Eigen::Vector4d::Zero();  ///< area times slip, area times speed
  };
  struct Normals {
    sheet::Vec3d normal, side_normal;
  };
  struct Place {
    std::uint32_t epoch = 0;
    std::uint32_t corner = 0;
  };
  using Corners = std::array<Corner*, 3>;
  using CornerPlaces = std::array<std::uint32_t, 3>;
  /// Contact area at places of a triangle, by corner. A place goes to the corners within reach, by their nearness; without
  /// any to the nearest corner.
  struct Shares {
    explicit Shares(const Corners& corners);
    void add(const std::array<double, 3>& barycentric, double contact_m2, const sheet::Vec3d& slip);

    std::array<double, 3> reached;  ///< 1 or 0
    std::array<double, 3> area_m2{};
    std::array<Eigen::Vector4d, 3> moved = {Eigen::Vector4d::Zero(), Eigen::Vector4d::Zero(), Eigen::Vector4d::Zero()};
    bool beyond_corners = false;
  };
  /// What one call works on.
  struct Inputs {
    const ContactGeometry& geometry;
    ContactSurface& surface;
    const VertexVelocities& velocities;
    const ContactWeight& weight;
    double radius_m;
    double margin_m;  ///< distances from corners are known this far beyond the radius
  };

  void measure_on_plane(const Inputs& in, const ContactPlane& plane);
  void find_corners(const Inputs& in);
  void see_plane(const Inputs& in, const ContactPlane& plane);
  std::uint32_t corner_at(const Inputs& in, std::uint32_t triangle, int k);
  void measure_triangle(const Inputs& in, std::uint32_t triangle, float area_m2);
  bool faces_a_plane(const Inputs& in, const CornerPlaces& corners) const;
  void lump(const CornerPlaces& corners, float area_m2);
  void integrate(const Inputs& in, const CornerPlaces& at, float area_m2);
  void integrate_batch(const Inputs& in);
  void take_samples(const Inputs& in, std::uint32_t triangle, const Corners& corners, double area_m2, int along);
  void take(const Corners& corners, const Shares& shares, std::uint32_t partner_triangle);
  void collect(const Inputs& in);

  ContactPatch patch_;
  PlaneBatch batch_;
  std::vector<Place> places_;  ///< [V]
  std::vector<Corner> corners_;
  std::vector<Normals> normals_;                ///< of the partner at each corner, empty for a plane
  std::vector<float> areas_m2_;                 ///< of the patch's triangles
  std::vector<CornerPlaces> triangle_corners_;  ///< likewise, for a plane
  std::vector<std::uint32_t> order_;            ///< corners in order of their vertices
  std::uint32_t epoch_ = 0;
  bool beyond_corners_ = false;  ///< a vertex counts as touching for a place on a triangle without corners in reach
};

}  // namespace rustle::analysis
