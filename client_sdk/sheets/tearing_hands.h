#pragma once

#include <array>
#include <cstddef>

#include "client_sdk/sheets/motions.h"
#include "client_sdk/sheets/plane_vector.h"

/// The two hands that tear a sheet (paper tearing 2015, section 3 and Fig. 2). Material coordinates are those of the
/// rectangle [0, width] x [0, height]; the sheet lies on the table z = 0.
namespace rustle::sheets {

/// Hands and sides are told apart as seen by one who goes along with the tear.
enum TornSide : std::size_t { kLeft = 0, kRight = 1 };

/// Where a hand holds the sheet, in the material plane.
struct Grip {
  Point2 thumb_m, index_m;
};
using Grips = std::array<Grip, 2>;  ///< by TornSide

/// Hands that tear a sheet of this size from the middle of its edge y = height toward y = 0.
[[nodiscard]] Grips usual_grips(const RectangleSize& size);

/// What a hand does during one step.
struct HandMotion {
  double rotation_rad = 0;    ///< Δθ about the crack tip; > 0 opens the tear, < 0 closes it
  Point2 translation_m = {};  ///< over the table
  Point2 slide_m = {};        ///< of its fingers over the sheet, in the material plane: it grips farther on
};
using HandMotions = std::array<HandMotion, 2>;  ///< by TornSide

/// A rigid motion from the material plane to the table.
struct PlanarPose {
  double angle_rad = 0;  ///< counter-clockwise
  Point2 fixed_m = {};   ///< this material point
  Point2 placed_m = {};  ///< lies here

  Point2 at(Point2 material_m) const { return placed_m + turned(material_m - fixed_m, angle_rad); }
};

/// Both hands and the crack tip. The planar region of each hand turns about the tip, where the two meet.
struct TearPose {
  Grips grips;
  Point2 tip_m = {};         ///< s, in the material plane
  Point2 placed_tip_m = {};  ///< on the table
  std::array<double, 2> angle_rad = {0, 0};

  PlanarPose region(TornSide side) const { return {angle_rad[side], tip_m, placed_tip_m}; }
  /// Angle by which the two regions have turned apart.
  double opening_rad() const { return angle_rad[kRight] - angle_rad[kLeft]; }
  /// Angle between the two thumbs as seen from the tip in the flat sheet; in (-π, π], > 0 while both lie ahead.
  double thumbs_angle_rad() const;
  /// (L - d) / L: L the distance between the thumbs in the flat sheet, d that on the table.
  double strain() const;
};

}  // namespace rustle::sheets
