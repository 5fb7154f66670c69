#include "client_sdk/sheets/shape.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>

namespace rustle::sheets {
namespace {

constexpr double kRidgeLength_m = 1e-7;  ///< a sharp fold is an arc this short
constexpr double kWidestRidge_m = 0.008;
constexpr double kLeastRidge_rad = 0.5;

double sinc(double x) {
  return std::abs(x) < 1e-4 ? 1 - x * x / 6 : std::sin(x) / x;
}

ArcCurve::Pose advance(const ArcCurve::Pose& from, double curvature_per_m, double distance_m) {
  const double half_turn = 0.5 * curvature_per_m * distance_m;
  const double chord = distance_m * sinc(half_turn);
  return {from.x_m + chord * std::cos(from.heading_rad + half_turn),
          from.z_m - chord * std::sin(from.heading_rad + half_turn), from.heading_rad + curvature_per_m * distance_m};
}

ArcCurve curve_with_ridges(const std::vector<double>& breaks, const std::vector<double>& curvatures,
                           std::span<const Ridge> ridges) {
  std::vector<double> all_breaks = breaks;
  for (const Ridge& ridge : ridges) {
    all_breaks.push_back(ridge.s_m - kRidgeLength_m / 2);
    all_breaks.push_back(ridge.s_m + kRidgeLength_m / 2);
  }
  std::sort(all_breaks.begin(), all_breaks.end());
  std::vector<double> all_curvatures;
  for (std::size_t k = 0; k <= all_breaks.size(); ++k) {
    const double low = k > 0 ? all_breaks[k - 1] : all_breaks.empty() ? 0.0 : all_breaks[0] - 1;
    const double high = k < all_breaks.size() ? all_breaks[k] : low + 1;
    const double middle = 0.5 * (low + high);
    const auto piece = std::upper_bound(breaks.begin(), breaks.end(), middle) - breaks.begin();
    double curvature = curvatures[static_cast<std::size_t>(piece)];
    for (const Ridge& ridge : ridges) {
      if (std::abs(middle - ridge.s_m) < kRidgeLength_m / 2) curvature = ridge.angle_rad / kRidgeLength_m;
    }
    all_curvatures.push_back(curvature);
  }
  return {std::move(all_breaks), std::move(all_curvatures), 0.0, {}};
}

std::vector<NamedShape> make_zoo() {
  constexpr double kLong = 0.297;
  constexpr double kShort = 0.210;
  const double k10 = 1 / radius_from_compression_m(kLong, 0.10);
  const double k30 = 1 / radius_from_compression_m(kLong, 0.30);
  const double degree = std::numbers::pi / 180;
  std::vector<NamedShape> zoo;
  const auto bent = [&](std::string name, double width, double height, double angle, std::vector<double> breaks,
                        std::vector<double> curvatures, std::vector<Ridge> ridges = {}) {
    zoo.push_back({std::move(name), width, height,
                   std::make_shared<BentShape>(width, height, angle, std::move(breaks), std::move(curvatures), ridges)});
  };
  bent("flat", kLong, kShort, 0, {}, {0});
  bent("strip10", kLong, kShort, 0, {}, {k10});
  bent("strip30", kLong, kShort, 0, {}, {k30});
  bent("strip30_oblique", kLong, kShort, 18 * degree, {}, {k30});
  bent("strip10_5cm", 0.05, 0.10, 0, {}, {1 / radius_from_compression_m(0.05, 0.10)});
  bent("strip10_2.5cm", 0.025, 0.10, 0, {}, {1 / radius_from_compression_m(0.025, 0.10)});
  zoo.push_back({"cone", kLong, kShort,
                 std::make_shared<ConeShape>(kLong, kShort, std::array<double, 2>{0.1485, -0.10}, 40 * degree)});
  bent("sbend", kLong, kShort, 0, {0}, {8, -8});
  bent("sbend_oblique", kLong, kShort, 18 * degree, {0.01}, {8, -8});
  bent("half_bent", kLong, kShort, 0, {0.02}, {0, 9});
  bent("ridge", kLong, kShort, 0, {}, {0}, {{0.03, 1.0}});
  bent("ridge_oblique", kLong, kShort, 25 * degree, {}, {0}, {{0.03, 1.0}});
  bent("fold3mm", kLong, kShort, 25 * degree, {0.03, 0.033}, {0, 1 / 0.003, 0});
  bent("bent_ridge", kLong, kShort, 0, {}, {6}, {{0.03, 1.0}});
  bent("dogear", kLong, kShort, std::atan2(kShort, kLong), {0.11, 0.115}, {0, 1.5 / 0.005, 0});
  bent("folded", kLong, kShort, 0, {}, {4}, {{0, 1.2}});
  return zoo;
}

}  // namespace

ArcCurve::ArcCurve(std::vector<double> breaks_m, std::vector<double> curvatures_per_m, double start_s_m, Pose start)
    : breaks_m_(std::move(breaks_m)), curvatures_per_m_(std::move(curvatures_per_m)) {
  assert(curvatures_per_m_.size() == breaks_m_.size() + 1);
  const std::size_t pieces = curvatures_per_m_.size();
  origin_s_m_.resize(pieces);
  poses_.resize(pieces);
  const std::size_t first = piece(start_s_m);
  origin_s_m_[first] = start_s_m;
  poses_[first] = start;
  for (std::size_t k = first + 1; k < pieces; ++k) {
    origin_s_m_[k] = breaks_m_[k - 1];
    poses_[k] = advance(poses_[k - 1], curvatures_per_m_[k - 1], breaks_m_[k - 1] - origin_s_m_[k - 1]);
  }
  for (std::size_t k = first; k-- > 0;) {
    origin_s_m_[k] = breaks_m_[k];
    poses_[k] = advance(poses_[k + 1], curvatures_per_m_[k + 1], breaks_m_[k] - origin_s_m_[k + 1]);
  }
}

std::size_t ArcCurve::piece(double s_m) const {
  return static_cast<std::size_t>(std::upper_bound(breaks_m_.begin(), breaks_m_.end(), s_m) - breaks_m_.begin());
}

ArcCurve::Pose ArcCurve::at(double s_m) const {
  const std::size_t k = piece(s_m);
  return advance(poses_[k], curvatures_per_m_[k], s_m - origin_s_m_[k]);
}

double ArcCurve::curvature_per_m(double s_m) const {
  return curvatures_per_m_[piece(s_m)];
}

BentShape::BentShape(double width_m, double height_m, double angle_rad, std::vector<double> breaks_m,
                     std::vector<double> curvatures_per_m, std::span<const Ridge> ridges)
    : width_m_(width_m),
      height_m_(height_m),
      direction_{std::cos(angle_rad), std::sin(angle_rad)},
      breaks_m_(std::move(breaks_m)),
      curvatures_per_m_(std::move(curvatures_per_m)),
      curve_(curve_with_ridges(breaks_m_, curvatures_per_m_, ridges)) {
  for (const Ridge& ridge : ridges) ridges_s_m_.push_back(ridge.s_m);
  std::sort(ridges_s_m_.begin(), ridges_s_m_.end());
}

double BentShape::along(double u_m, double v_m) const {
  return (u_m - width_m_ / 2) * direction_[0] + (v_m - height_m_ / 2) * direction_[1];
}

Point3 BentShape::at(double u_m, double v_m) const {
  const double across = -(u_m - width_m_ / 2) * direction_[1] + (v_m - height_m_ / 2) * direction_[0];
  const ArcCurve::Pose pose = curve_.at(along(u_m, v_m));
  return {pose.x_m * direction_[0] - across * direction_[1], pose.x_m * direction_[1] + across * direction_[0], pose.z_m};
}

double BentShape::curvature_per_m(double u_m, double v_m) const {
  const auto piece = std::upper_bound(breaks_m_.begin(), breaks_m_.end(), along(u_m, v_m)) - breaks_m_.begin();
  return curvatures_per_m_[static_cast<std::size_t>(piece)];
}

std::array<double, 2> BentShape::ruling(double, double) const {
  return {-direction_[1], direction_[0]};
}

int BentShape::piece(double u_m, double v_m) const {
  const double s = along(u_m, v_m);
  const auto k = static_cast<std::size_t>(std::upper_bound(breaks_m_.begin(), breaks_m_.end(), s) - breaks_m_.begin());
  if (k > 0 && k < breaks_m_.size()) {
    const double width_m = breaks_m_[k] - breaks_m_[k - 1];
    if (width_m <= kWidestRidge_m && std::abs(curvatures_per_m_[k]) * width_m > kLeastRidge_rad) return kInRidge;
  }
  const auto ridge = std::upper_bound(ridges_s_m_.begin(), ridges_s_m_.end(), s) - ridges_s_m_.begin();
  return static_cast<int>(k + static_cast<std::size_t>(ridge));
}

ConeShape::ConeShape(double width_m, double height_m, std::array<double, 2> apex_m, double half_angle_rad)
    : apex_m_(apex_m),
      half_angle_rad_(half_angle_rad),
      middle_rad_(std::atan2(height_m / 2 - apex_m[1], width_m / 2 - apex_m[0])) {}

Point3 ConeShape::at(double u_m, double v_m) const {
  const double u = u_m - apex_m_[0];
  const double v = v_m - apex_m_[1];
  const double slant = std::hypot(u, v);
  const double turn = std::remainder(std::atan2(v, u) - middle_rad_, 2 * std::numbers::pi) / std::sin(half_angle_rad_);
  const double ring = slant * std::sin(half_angle_rad_);
  return {-ring * std::sin(turn), slant * std::cos(half_angle_rad_), ring * std::cos(turn)};
}

double ConeShape::curvature_per_m(double u_m, double v_m) const {
  return 1 / (std::hypot(u_m - apex_m_[0], v_m - apex_m_[1]) * std::tan(half_angle_rad_));
}

std::array<double, 2> ConeShape::ruling(double u_m, double v_m) const {
  const double u = u_m - apex_m_[0];
  const double v = v_m - apex_m_[1];
  const double slant = std::hypot(u, v);
  return {u / slant, v / slant};
}

int ConeShape::piece(double, double) const {
  return 0;
}

double radius_from_compression_m(double length_m, double compression) {
  double low = 1e-6;
  double high = std::numbers::pi;
  for (int k = 0; k < 80; ++k) {
    const double middle = 0.5 * (low + high);
    (std::sin(middle) / middle > 1 - compression ? low : high) = middle;
  }
  return length_m / (2 * low);
}

const std::vector<NamedShape>& shape_zoo() {
  static const std::vector<NamedShape> zoo = make_zoo();
  return zoo;
}

const NamedShape* find_shape(std::string_view name) {
  for (const NamedShape& shape : shape_zoo()) {
    if (shape.name == name) return &shape;
  }
  return nullptr;
}

}  // namespace rustle::sheets
