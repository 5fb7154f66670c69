#include "server/sheet/transfer.h"

#include <algorithm>

#include <catch2/catch.hpp>

#include "meshes.h"

namespace transfer_test {

using namespace rustle;
using sheet::Vec2f;
using sheet::Vec3f;

namespace {

/// A square cut along y = 0.1 from x = 0.1 to the right: the vertices there are doubled.
struct Cut {
  std::vector<Vec2f> uv_m;
  std::vector<sheet::Triangle> triangles;
};
Cut cut_square(std::uint32_t cells) {
  const test::Grid grid(cells, cells, 0.2f, 0.2f);
  Cut out{grid.uv_m, grid.triangles};
  std::vector<std::uint32_t> twin(grid.uv_m.size(), sheet::kNone);
  for (std::uint32_t i = 0; i < grid.uv_m.size(); ++i) {
    if (std::fabs(grid.uv_m[i].y() - 0.1f) < 1e-5f && grid.uv_m[i].x() > 0.1f + 1e-5f) {
      twin[i] = static_cast<std::uint32_t>(out.uv_m.size());
      out.uv_m.push_back(grid.uv_m[i]);
    }
  }
  for (auto& v : out.triangles) {
    const float y = (grid.uv_m[v[0]].y() + grid.uv_m[v[1]].y() + grid.uv_m[v[2]].y()) / 3;
    for (auto& k : v) {
      if (y > 0.1f && twin[k] != sheet::kNone) k = twin[k];
    }
  }
  return out;
}

float value(const sheet::Transfer::Origin& o, const std::vector<float>& x) {
  return o.weights[0] * x[o.vertices[0]] + o.weights[1] * x[o.vertices[1]] + o.weights[2] * x[o.vertices[2]];
}

}  // namespace

TEST_CASE("by material: linear fields arrive unchanged and kept vertices are known") {
  const test::Grid from(10, 10, 0.2f, 0.2f), to(15, 15, 0.2f, 0.2f);
  const auto a = test::topology(from.uv_m.size(), from.triangles, from.uv_m);
  const auto b = test::topology(to.uv_m.size(), to.triangles, to.uv_m);
  std::vector<float> field;
  for (const auto& p : from.uv_m) field.push_back(3 * p.x() - 7 * p.y() + 1);
  const auto transfer = sheet::transfer_by_material(*a, *b);
  for (std::size_t i = 0; i < to.uv_m.size(); ++i) {
    CHECK(value(transfer.origins[i], field) == Approx(3 * to.uv_m[i].x() - 7 * to.uv_m[i].y() + 1).margin(1e-5));
    const auto on = [](float x) { return std::fabs(x / 0.02f - std::round(x / 0.02f)) < 1e-3f; };
    CHECK(transfer.remade[i] == !(on(to.uv_m[i].x()) && on(to.uv_m[i].y())));
  }
}

TEST_CASE("by material: nothing crosses a crack") {
  const Cut from = cut_square(10), to = cut_square(14);
  const auto a = test::topology(from.uv_m.size(), from.triangles, from.uv_m);
  const auto b = test::topology(to.uv_m.size(), to.triangles, to.uv_m);
  std::vector<float> field(from.uv_m.size(), 0.0f);
  for (const auto& v : from.triangles) {  // 1 beyond the crack, right of its tip
    const float y = (from.uv_m[v[0]].y() + from.uv_m[v[1]].y() + from.uv_m[v[2]].y()) / 3;
    for (auto k : v) field[k] = y > 0.1f ? 1.0f : field[k];
  }
  const auto transfer = sheet::transfer_by_material(*a, *b);
  for (const auto& v : to.triangles) {
    const Vec2f c = (to.uv_m[v[0]] + to.uv_m[v[1]] + to.uv_m[v[2]]) / 3.0f;
    if (c.x() < 0.13f || std::fabs(c.y() - 0.1f) > 0.02f) continue;
    for (auto k : v) CHECK(value(transfer.origins[k], field) == Approx(c.y() > 0.1f ? 1 : 0).margin(1e-3));
  }
}

TEST_CASE("by position: a renumbered sheet in motion is recognised, another one is not") {
  const test::Grid grid(12, 9, 0.3f, 0.2f);
  const auto n = static_cast<std::uint32_t>(grid.uv_m.size());
  const auto a = test::topology(n, grid.triangles);
  auto triangles = grid.triangles;
  for (auto& v : triangles) {
    for (auto& k : v) k = k * 7 % n;  // 7 and 130 share no factor
  }
  REQUIRE(n == 130);
  std::reverse(triangles.begin(), triangles.end());
  const auto b = test::topology(n, triangles);
  const auto old_places = grid.mapped([](Vec2f p) { return test::rolled(p, 0.1f); });
  std::vector<Vec3f> places(n);
  for (std::uint32_t i = 0; i < n; ++i) places[i * 7 % n] = old_places[i] + Vec3f(0.003f, 0.002f, -0.002f);
  const auto transfer = sheet::transfer_by_position(*a, old_places, *b, places);
  REQUIRE(transfer.has_value());
  for (std::uint32_t i = 0; i < n; ++i) {
    CHECK(transfer->origins[i * 7 % n].closest() == i);
    CHECK_FALSE(transfer->remade[i * 7 % n]);
  }
  const test::Grid other(13, 11, 0.3f, 0.2f);
  CHECK_FALSE(sheet::transfer_by_position(*a, old_places, *test::topology(other.uv_m.size(), other.triangles),
                                          other.mapped([](Vec2f p) { return test::rolled(p, 0.1f); })));
}

TEST_CASE("by position: a welded seam joins its vertices, an opened one finds both sides") {
  const Cut open = cut_square(10);
  const test::Grid closed(10, 10, 0.2f, 0.2f);
  const auto flat = [](const std::vector<Vec2f>& uv) {
    std::vector<Vec3f> out;
    for (const auto& p : uv) out.emplace_back(p.x(), p.y(), 0.0f);
    return out;
  };
  const auto a = test::topology(open.uv_m.size(), open.triangles);
  const auto b = test::topology(closed.uv_m.size(), closed.triangles);
  const auto weld = sheet::transfer_by_position(*a, flat(open.uv_m), *b, flat(closed.uv_m));
  REQUIRE(weld.has_value());
  CHECK(std::count(weld->remade.begin(), weld->remade.end(), true) == 0);
  const auto open_again = sheet::transfer_by_position(*a, flat(open.uv_m), *a, flat(open.uv_m));
  REQUIRE(open_again.has_value());
  for (std::uint32_t i = 0; i < open.uv_m.size(); ++i) CHECK(open_again->origins[i].closest() == i);
}

TEST_CASE("the same structure is known without being the same object") {
  const test::Grid grid(4, 4, 0.1f, 0.1f);
  const auto a = test::topology(grid.uv_m.size(), grid.triangles, grid.uv_m);
  const auto b = test::topology(grid.uv_m.size(), grid.triangles, grid.uv_m);
  CHECK(sheet::same_structure(*a, *b));
  auto moved = grid.uv_m;
  moved[3].x() += 0.001f;
  CHECK_FALSE(sheet::same_structure(*a, *test::topology(grid.uv_m.size(), grid.triangles, moved)));
}

}  // namespace transfer_test
