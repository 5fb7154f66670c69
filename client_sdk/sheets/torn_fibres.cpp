#include "client_sdk/sheets/torn_fibres.h"

#include <algorithm>
#include <cmath>

#include "client_sdk/sheets/plane_noise.h"

namespace rustle::sheets {
namespace {

constexpr double kLongest = 4;      // mean lengths
constexpr double kSplay_rad = 1.2;  // to either side
constexpr double kLift_rad = 0.6;

}  // namespace

std::vector<TornFibre> torn_fibres(const TornMesh& mesh, const FibreOptions& options) {
  std::vector<TornFibre> fibres;
  const auto& uv = mesh.mesh().material_coordinates;
  for (const auto side : {kLeft, kRight}) {
    const auto lip = mesh.lip(side);
    for (std::size_t k = 0; k + 1 < lip.size(); ++k) {
      const auto &a = uv[lip[k]], &b = uv[lip[k + 1]];
      const double edge_m = std::hypot(static_cast<double>(b[0]) - a[0], static_cast<double>(b[1]) - a[1]);
      const auto edge = static_cast<std::int64_t>(2 * k + side);
      const auto at_random = [&](std::int64_t n, std::int64_t what) {
        return hashed_unit(options.seed, edge, 8 * n + what);
      };
      const auto count = static_cast<std::int64_t>(options.per_m * edge_m + at_random(-1, 0));
      for (std::int64_t n = 0; n < count; ++n) {
        TornFibre fibre{lip[k], lip[k + 1], at_random(n, 0), 0, 0, 0};
        fibre.length_m = options.mean_length_m * std::min(kLongest, -std::log1p(-at_random(n, 1)));
        fibre.splay_rad = kSplay_rad * (2 * at_random(n, 2) - 1);
        fibre.lift_rad = kLift_rad * (2 * at_random(n, 3) - 1);
        fibres.push_back(fibre);
      }
    }
  }
  return fibres;
}

}  // namespace rustle::sheets
