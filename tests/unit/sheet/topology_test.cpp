#include "server/sheet/topology.h"

#include <limits>

#include <catch2/catch.hpp>

#include "meshes.h"

namespace topology_test {

using namespace rustle;
using sheet::Topology;

TEST_CASE("a rectangle has the edges Euler counts, each seen from both of its triangles") {
  const test::Grid grid(5, 4, 0.5f, 0.4f);
  const auto t = test::topology(grid.uv_m.size(), grid.triangles);
  CHECK(t->triangle_count() == 40);
  CHECK(t->border_edges().size() == 18);
  CHECK(t->interior_edges().size() == (3 * 40 - 18) / 2);
  CHECK(t->vertex_count() - (t->interior_edges().size() + t->border_edges().size()) + t->triangle_count() == 1);
  for (const auto& e : t->interior_edges()) {
    CHECK(e.consistent);
    const auto runs = [&](std::uint32_t f, std::uint32_t a, std::uint32_t b) {
      const auto& v = t->triangles()[f];
      return (v[0] == a && v[1] == b) || (v[1] == a && v[2] == b) || (v[2] == a && v[0] == b);
    };
    CHECK(runs(e.left, e.start, e.end));
    CHECK(runs(e.right, e.end, e.start));
  }
  for (std::uint32_t f = 0; f < t->triangle_count(); ++f) {
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t index = t->triangle_edges()[f][k];
      if (index == sheet::kNone) continue;
      const auto& e = t->interior_edges()[index];
      CHECK((e.left == f || e.right == f));
      const std::uint32_t a = t->triangles()[f][k], b = t->triangles()[f][(k + 1) % 3];
      CHECK(((e.start == a && e.end == b) || (e.start == b && e.end == a)));
    }
  }
}

TEST_CASE("wrong topologies are refused by the name of the field") {
  Topology::Input input;
  input.vertex_count = 3;
  input.triangles = {{0, 1, 3}};
  CHECK_THAT(Topology::make(input).error(), Catch::Contains("triangles") && Catch::Contains("vertex 3"));
  input.triangles = {{0, 1, 2}};
  input.material_coordinates_m.assign(2, sheet::Vec2f::Zero());
  CHECK_THAT(Topology::make(input).error(), Catch::Contains("material_coordinates"));
  input.material_coordinates_m.assign(3, sheet::Vec2f(0, std::numeric_limits<float>::quiet_NaN()));
  CHECK_THAT(Topology::make(input).error(), Catch::Contains("material_coordinates") && Catch::Contains("finite"));
  input.material_coordinates_m.clear();
  input.rest_positions_m.assign(4, sheet::Vec3f::Zero());
  CHECK_THAT(Topology::make(input).error(), Catch::Contains("rest_positions"));
  input.rest_positions_m.clear();
  CHECK(Topology::make(input).has_value());
}

TEST_CASE("flaws are tolerated and counted") {
  // three triangles on one edge, one turned against its neighbour, one with a repeated vertex, two vertices unused
  const auto t = test::topology(10, {{0, 1, 2}, {1, 0, 3}, {0, 1, 4}, {4, 1, 5}, {4, 1, 6}, {7, 7, 2}, {2, 3, 3}});
  CHECK(t->flaws().degenerate_triangles == 2);
  CHECK(t->flaws().non_manifold_edges == 2);
  CHECK(t->flaws().unused_vertices == 2);
  const auto twisted = test::topology(4, {{0, 1, 2}, {0, 1, 3}});
  CHECK(twisted->flaws().inconsistent_edges == 1);
  CHECK_FALSE(twisted->interior_edges()[0].consistent);
  CHECK(test::topology(0, {})->triangle_count() == 0);
}

}  // namespace topology_test
