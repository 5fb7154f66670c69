#include "server/analysis/rulings.h"

#include <algorithm>
#include <cmath>

#include <catch2/catch.hpp>

#include "tests/unit/sheet/meshes.h"

namespace rulings_test {

using namespace rustle;
using sheet::Vec2f;

namespace {

/// 20 x 10 cm, cells of 1 cm; a band from 8 to 10 cm is a region of its own.
struct Banded {
  test::Grid grid{20, 10, 0.2f, 0.1f};
  analysis::RegionStencils stencils;
  analysis::RegionMap map;
  analysis::Outlines outlines;

  Banded() {
    const auto topology = test::topology(grid.uv_m.size(), grid.triangles, grid.uv_m);
    stencils = analysis::region_stencils(topology, sheet::rest_plane(*topology, {}), {});
    for (const auto& t : grid.triangles) {
      const float x = (grid.uv_m[t[0]].x() + grid.uv_m[t[1]].x() + grid.uv_m[t[2]].x()) / 3;
      map.region.push_back(x > 0.08f && x < 0.1f ? 1 : 0);
    }
    map.region_count = 2;
    const auto edges = topology->interior_edges();
    for (std::uint32_t k = 0; k < edges.size(); ++k) {
      if (map.region[edges[k].left] != map.region[edges[k].right]) map.cuts.push_back(k);
    }
    analysis::outline_regions(stencils, map, outlines);
  }

  double length_m(std::uint32_t region, Vec2f at_m, double angle_rad, float gap_m) const {
    const Vec2f direction(static_cast<float>(std::cos(angle_rad)), static_cast<float>(std::sin(angle_rad)));
    analysis::RulingTracer tracer;
    return tracer.length_m(outlines, region, stencils.rest_m[0] + at_m, direction, gap_m);
  }
};

}  // namespace

TEST_CASE("a ruling ends where its region does, a gap narrower than allowed apart") {
  const Banded sheet;
  const Vec2f left(0.03f, 0.0521f), band(0.0912f, 0.0521f), right(0.1503f, 0.0521f);
  CHECK(sheet.length_m(0, left, 0, 0.03f) == Approx(0.2).epsilon(1e-4));
  CHECK(sheet.length_m(0, right, 0, 0.03f) == Approx(0.2).epsilon(1e-4));
  CHECK(sheet.length_m(0, left, 0, 0.01f) == Approx(0.08).epsilon(1e-4));
  CHECK(sheet.length_m(0, right, 0, 0.01f) == Approx(0.1).epsilon(1e-4));
  CHECK(sheet.length_m(1, band, 0, 0.01f) == Approx(0.02).epsilon(1e-4));
  CHECK(sheet.length_m(1, band, std::acos(0.0), 0.01f) == Approx(0.1).epsilon(1e-4));
}

TEST_CASE("a ruling has one length, whichever of its places and ways it is followed from") {
  const Banded sheet;
  for (double angle = 0.05; angle < 3.1; angle += 0.17) {
    const Vec2f place(0.0312f, 0.0407f), direction(static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle)));
    const double length = sheet.length_m(0, place, angle, 0.001f);
    CHECK(sheet.length_m(0, place, angle + 2 * std::acos(0.0), 0.001f) == Approx(length).epsilon(1e-4));
    CHECK(sheet.length_m(0, place + 0.01f * direction, angle, 0.001f) == Approx(length).epsilon(1e-4));
    CHECK(length >= 0.08 - 1e-6);
  }
}

TEST_CASE("triangles next to each other along the curve are near each other in the rest plane") {
  const Banded sheet;
  const auto& order = sheet.stencils.order;
  std::vector<std::uint32_t> sorted = order;
  std::sort(sorted.begin(), sorted.end());
  for (std::uint32_t f = 0; f < sorted.size(); ++f) REQUIRE(sorted[f] == f);
  double mean_m = 0;
  for (std::size_t k = 1; k < order.size(); ++k) {
    mean_m += (sheet.stencils.centres_m[order[k]] - sheet.stencils.centres_m[order[k - 1]]).norm();
  }
  CHECK(mean_m / static_cast<double>(order.size() - 1) < 0.012);
}

}  // namespace rulings_test
