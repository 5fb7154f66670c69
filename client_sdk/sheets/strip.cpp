#include "client_sdk/sheets/strip.h"

#include <utility>
#include <vector>

namespace rustle::sheets {

ArcCurve strip_curve(double length_m, ArcCurve::Pose start, const std::function<double(double s_m)>& curvature_per_m) {
  constexpr int kArcs = 256;
  std::vector<double> breaks_m;
  std::vector<double> curvatures;
  for (int k = 0; k < kArcs; ++k) {
    if (k > 0) breaks_m.push_back(length_m * k / kArcs);
    curvatures.push_back(curvature_per_m(length_m * (k + 0.5) / kArcs));
  }
  return {std::move(breaks_m), std::move(curvatures), 0.0, start};
}

}  // namespace rustle::sheets
