#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "client_sdk/sheets/tearing_cone.h"
#include "client_sdk/sheets/tearing_sheet.h"
#include "server/validation/groups.h"

namespace rustle::validation {
namespace {

using sheets::kLeft;
using sheets::kRight;
using sheets::Point2;
using sheets::Point3;

constexpr double kThumbs_m = 0.08, kTip_m = 0.10;  // between the thumbs; from their middle to the tip
constexpr std::array<double, 5> kStrains = {0.02, 0.05, 0.1, 0.2, 0.3};
constexpr std::array<const char*, 3> kMaterials = {"tracing-paper", "printer-paper", "banknote"};

/// Both hands turned evenly until the thumbs have come so much closer.
sheets::TearPose pose_at(double strain) {
  sheets::TearPose pose;
  pose.tip_m = {0, kTip_m};
  pose.grips[kLeft].thumb_m = {kThumbs_m / 2, 0};
  pose.grips[kRight].thumb_m = {-kThumbs_m / 2, 0};
  double low = 0, high = pose.thumbs_angle_rad();
  for (int k = 0; k < 60; ++k) {
    const double mid = (low + high) / 2;
    pose.angle_rad = {-mid / 2, mid / 2};
    (pose.strain() < strain ? low : high) = mid;
  }
  return pose;
}

/// The greatest relative change of a short length on the cone.
double worst_stretch(const sheets::TearCone& cone, const sheets::TearPose& pose) {
  double worst = 0;
  const Point2 left = pose.grips[kLeft].thumb_m, right = pose.grips[kRight].thumb_m;
  for (int across = 1; across < 40; ++across) {
    for (int away = 1; away <= 10; ++away) {
      const Point2 p = pose.tip_m + 0.2 * away * (left + (across / 40.0) * (right - left) - pose.tip_m);
      for (int k = 0; k < 8; ++k) {
        const double step_m = 0.02 * sheets::length(p - pose.tip_m);
        const Point2 q = p + sheets::turned({step_m, 0}, 0.4 * k);
        if (!cone.covers(p) || !cone.covers(q)) continue;
        const Point3 a = cone.at(p), b = cone.at(q);
        worst = std::max(worst, std::abs(std::hypot(b[0] - a[0], b[1] - a[1], b[2] - a[2]) / step_m - 1));
      }
    }
  }
  return worst;
}

}  // namespace

Findings tear_cone(const Setting& setting) {
  Findings found;
  report::Plot plot;
  plot.x = {"compressive strain (%)", false, 0, 30, {}};
  plot.y = {"height over the thumbs' distance", false, 0, 0.4, {}};
  report::PlotSeries arch{"inextensible arch, (2/π) √ε", {}, report::Ink::kLevel, report::PlotSeries::Style::kDashed};
  for (double strain = 0; strain <= 0.3001; strain += 0.005)
    arch.points.push_back({100 * strain, sheets::arch_rise(strain)});
  plot.series.push_back(arch);
  for (std::size_t k = 0; k < kMaterials.size(); ++k) {
    report::PlotSeries series{kMaterials[k], {}, report::series_colour(static_cast<int>(k))};
    for (double strain = 0.0025; strain <= 0.3001; strain += 0.0025) {
      const sheets::TearCone cone(pose_at(strain), sheets::cone_roundness(kMaterials[k]));
      series.points.push_back({100 * strain, cone.height_m() / kThumbs_m});
    }
    plot.series.push_back(series);
  }
  double worst = 0;
  for (const double strain : kStrains) {
    const auto pose = pose_at(strain);
    const sheets::TearCone cone(pose, sheets::cone_roundness(setting.material));
    const double wanted = sheets::arch_rise(strain);
    Check& height = found.checks.emplace_back();
    height.name = fmt::format("tear_cone/height/{:.0f}%", 100 * strain);
    height.ours = cone.height_m() / kThumbs_m;
    height.bound = between(0.9 * wanted, 1.1 * wanted);
    height.bound.text = fmt::format("{:.3f} ± 10 %", wanted);
    height.meaning =
        "Fig. 9: height of the cone between the thumbs over their distance in the flat sheet; an inextensible arch has "
        "(2/π) √ε";
    worst = std::max(worst, 100 * worst_stretch(cone, pose));
  }
  found.checks.push_back({"tear_cone/lengths", worst, std::nullopt, at_most(1, "%"), "%",
                          "greatest change of a length anywhere on the cone, in any direction, at the strains above"});
  found.figures.push_back(
      {"Figure 9: height of the cone by strain (Lejemble et al. 2015)",
       "Two hands turn a torn sheet, the thumbs 8 cm apart, the tear's tip 10 cm from their middle. The "
       "paper's measured sheets follow the same root. Materials differ by how close to the thumbs they bend.",
       plot});
  return found;
}

}  // namespace rustle::validation
