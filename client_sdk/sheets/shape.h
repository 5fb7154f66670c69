#pragma once

#include <array>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace rustle::sheets {

using Point3 = std::array<double, 3>;

/// A developable surface: where each material point of a rectangle [0, width] x [0, height] lies in space. Lengths along
/// the surface are those in the material plane.
class Shape {
 public:
  virtual ~Shape() = default;
  virtual Point3 at(double u_m, double v_m) const = 0;
  /// Principal curvature across the rulings there, 1/m, > 0 where the sheet is a dome seen from its normals' side. The mean
  /// curvature is half of it.
  virtual double curvature_per_m(double u_m, double v_m) const = 0;
  /// Direction of the ruling through that point, unit length in the material plane.
  virtual std::array<double, 2> ruling(double u_m, double v_m) const = 0;
  /// The piece of the sheet that the point belongs to, bounded by rulings: parts of other bending and what lies beyond a
  /// ridge are other pieces. kInRidge: on a ridge of some width (at most 8 mm wide, turning by more than 0.5 rad).
  virtual int piece(double u_m, double v_m) const = 0;

  static constexpr int kInRidge = -1;
};

/// A plane curve of arcs: curvature piecewise constant along its length, > 0 turning downward. Exact.
class ArcCurve {
 public:
  struct Pose {
    double x_m = 0, z_m = 0;
    double heading_rad = 0;  ///< 0: along +x; > 0: downward
  };

  /// Piece k runs from breaks[k-1] to breaks[k] with curvatures[k]; the first and the last go on for ever.
  /// `start` is the pose at start_s. \pre breaks ascending, curvatures.size() == breaks.size() + 1
  ArcCurve(std::vector<double> breaks_m, std::vector<double> curvatures_per_m, double start_s_m, Pose start);

  Pose at(double s_m) const;
  double curvature_per_m(double s_m) const;

 private:
  std::size_t piece(double s_m) const;

  std::vector<double> breaks_m_, curvatures_per_m_;
  std::vector<double> origin_s_m_;  ///< of each piece: where its pose is known
  std::vector<Pose> poses_;
};

struct Ridge {
  double s_m;        ///< where, along the bend from the centre
  double angle_rad;  ///< sharp fold
};

/// A rectangle bent along the direction `angle_rad` in its material plane, all rulings across it; s runs from the centre.
/// The centre lies at the origin, level there (right after a bend or ridge that ends at the centre).
class BentShape : public Shape {
 public:
  BentShape(double width_m, double height_m, double angle_rad, std::vector<double> breaks_m,
            std::vector<double> curvatures_per_m, std::span<const Ridge> ridges = {});

  Point3 at(double u_m, double v_m) const override;
  double curvature_per_m(double u_m, double v_m) const override;  ///< a ridge counts as its two sides
  std::array<double, 2> ruling(double u_m, double v_m) const override;
  int piece(double u_m, double v_m) const override;

 private:
  double along(double u_m, double v_m) const;

  double width_m_, height_m_;
  std::array<double, 2> direction_;
  std::vector<double> breaks_m_, curvatures_per_m_;
  std::vector<double> ridges_s_m_;  ///< sharp ones, ascending
  ArcCurve curve_;
};

/// A rectangle rolled onto a cone, rulings through the apex, a material point outside the rectangle.
class ConeShape : public Shape {
 public:
  ConeShape(double width_m, double height_m, std::array<double, 2> apex_m, double half_angle_rad);

  Point3 at(double u_m, double v_m) const override;
  double curvature_per_m(double u_m, double v_m) const override;
  std::array<double, 2> ruling(double u_m, double v_m) const override;
  int piece(double u_m, double v_m) const override;

 private:
  std::array<double, 2> apex_m_;
  double half_angle_rad_, middle_rad_;
};

/// Radius of the arc of this length whose chord is (1 - compression) times as long: sin(x)/x = 1 - compression, R =
/// length/2x. \pre 0 < compression < 1
[[nodiscard]] double radius_from_compression_m(double length_m, double compression);

struct NamedShape {
  std::string name;
  double width_m, height_m;
  std::shared_ptr<const Shape> shape;
};

/// Analytic sheets to test geometry with, mostly A4 (0.297 x 0.210 m): flat, strip10, strip30, strip30_oblique,
/// strip10_5cm, strip10_2.5cm, cone, sbend, sbend_oblique, half_bent, ridge, ridge_oblique, fold3mm, bent_ridge, dogear,
/// folded (creased across its middle, both halves bowed, a tent on its two straight edges: Fig. 12 of Schreck et al. 2016).
[[nodiscard]] const std::vector<NamedShape>& shape_zoo();

/// Null: no such name.
[[nodiscard]] const NamedShape* find_shape(std::string_view name);

}  // namespace rustle::sheets
