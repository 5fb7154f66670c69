#pragma once

#include <vector>

#include "client_sdk/sheets/shape.h"
#include "client_sdk/sheets/tearing_hands.h"

namespace rustle::sheets {

/// The generalized cone between the thumbs, with its apex at the crack tip (paper tearing 2015, section 3, Figs. 2 and 3).
///
/// Two cubic Hermite curves run from thumb to thumb and meet at m; all tangents are parallel to the thumbs' line,
/// `roundness` times half the thumbs' distance long. m lies in the plane that halves the thumbs' line, as far from the apex
/// as the middle between the thumbs in the flat sheet; how high is solved for: the curve, seen from the apex, is as long as
/// the angle between the thumbs in the flat sheet. Every line from the apex keeps its lengths and its angle along the curve,
/// so the cone is isometric as a whole, not at the thumbs and m only. It meets both planar regions without a crease.
class TearCone {
 public:
  /// \pre 0 < pose.thumbs_angle_rad() < π; 0 ≤ pose.opening_rad() < pose.thumbs_angle_rad()
  TearCone(const TearPose& pose, double roundness);

  /// Whether a material point lies between the lines from the tip through the thumbs, as far as the sheet's border.
  bool covers(Point2 material_m) const;
  /// Where a material point lies that it covers; any point, as though it did.
  Point3 at(Point2 material_m) const;

  double strain() const { return strain_; }
  /// From the thumbs' line on the table to the top of the arch that they have between them.
  double rise_m() const { return rise_m_; }
  /// Of the arch's top over the table.
  double height_m() const { return height_m_; }

 private:
  Point3 direction(double along_rad) const;

  Point2 tip_m_, placed_tip_m_;
  Point2 left_;           ///< from the tip to the left thumb, unit length, in the material plane
  double angle_rad_ = 0;  ///< between the thumbs, in the flat sheet
  double opening_rad_ = 0;
  double left_heading_rad_ = 0;     ///< of the line to the left thumb, on the table
  std::vector<Point3> directions_;  ///< unit vectors from the apex along the curve, left to right
  std::vector<double> along_rad_;   ///< length of the curve, seen from the apex, up to each
  double strain_ = 0, rise_m_ = 0, height_m_ = 0;
};

/// Height of an inextensible arch over its unbent length at a small compressive strain: (2/π) √ε.
[[nodiscard]] double arch_rise(double strain);

}  // namespace rustle::sheets
