#include "client_sdk/sheets/tearing_sheet.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <numeric>
#include <tuple>
#include <utility>
#include <vector>

#include <catch2/catch.hpp>

#include "client_sdk/sheets/stream_demos.h"
#include "client_sdk/sheets/tearing_scripts.h"

namespace tearing_sheet_test {

namespace {

using namespace rustle::sheets;

using Edge = std::pair<std::uint32_t, std::uint32_t>;

double area_m2(const SheetMesh& mesh) {
  double area = 0;
  for (const auto& t : mesh.triangles) {
    const auto &a = mesh.material_coordinates[t[0]], &b = mesh.material_coordinates[t[1]],
               &c = mesh.material_coordinates[t[2]];
    const double twice = (static_cast<double>(b[0]) - a[0]) * (static_cast<double>(c[1]) - a[1]) -
                         (static_cast<double>(b[1]) - a[1]) * (static_cast<double>(c[0]) - a[0]);
    REQUIRE(twice > 0);
    area += twice / 2;
  }
  return area;
}

struct Form {
  std::size_t pieces = 0;
  int euler = 0;
  double border_m = 0;
};

/// Requires an oriented manifold with one border through every border vertex; counts its pieces.
Form form_of(const SheetMesh& mesh) {
  const std::size_t vertices = mesh.material_coordinates.size();
  std::map<Edge, int> directed;
  std::vector<std::uint32_t> piece(vertices);
  std::iota(piece.begin(), piece.end(), 0u);
  const auto root = [&](std::uint32_t v) {
    while (piece[v] != v) v = piece[v] = piece[piece[v]];
    return v;
  };
  std::vector<bool> used(vertices, false);
  for (const auto& t : mesh.triangles) {
    for (std::size_t k = 0; k < 3; ++k) {
      REQUIRE(t[k] < vertices);
      used[t[k]] = true;
      ++directed[{t[k], t[(k + 1) % 3]}];
      piece[root(t[k])] = root(t[(k + 1) % 3]);
    }
  }
  REQUIRE(std::count(used.begin(), used.end(), false) == 0);
  Form form;
  std::vector<int> leaving(vertices, 0);
  std::size_t edges = 0;
  for (const auto& [edge, count] : directed) {
    REQUIRE(count == 1);  // two triangles meet in opposite directions: no more than two at an edge
    const bool inner = directed.count({edge.second, edge.first}) > 0;
    if (!inner || edge.first < edge.second) ++edges;
    if (inner) continue;
    ++leaving[edge.first];
    const auto &a = mesh.material_coordinates[edge.first], &b = mesh.material_coordinates[edge.second];
    form.border_m += std::hypot(static_cast<double>(b[0]) - a[0], static_cast<double>(b[1]) - a[1]);
  }
  for (const int out : leaving) REQUIRE(out <= 1);
  for (std::uint32_t v = 0; v < vertices; ++v) form.pieces += root(v) == v ? 1 : 0;
  form.euler = static_cast<int>(vertices) - static_cast<int>(edges) + static_cast<int>(mesh.triangles.size());
  return form;
}

double path_length_m(std::span<const Point2> path) {
  double sum = 0;
  for (std::size_t k = 1; k < path.size(); ++k) sum += length(path[k] - path[k - 1]);
  return sum;
}

TearingOptions options_of(std::uint64_t seed, std::size_t triangles = 446) {
  TearingOptions options;
  options.seed = seed;
  options.triangles = triangles;
  return options;
}

/// Lets a script tear a sheet; `seen` is told after every step.
template <typename Seen>
TearingSheet tear(std::string_view name, const TearingOptions& options, double dt_s, const Seen& seen) {
  auto sheet = TearingSheet::make(options);
  REQUIRE(sheet);
  const auto script = make_tear_script(name);
  REQUIRE(script);
  for (double t = 0; t < script->duration_s(); t += dt_s) {
    const auto step = sheet->advance(script->motions(*sheet, t, dt_s), dt_s);
    REQUIRE(step);
    seen(*sheet, *step, t);
  }
  return std::move(*sheet);
}

std::vector<float> positions_of(const TearingSheet& sheet) {
  std::vector<float> xyz(3 * sheet.mesh()->material_coordinates.size());
  sheet.positions(xyz);
  return xyz;
}

double distance(const std::vector<float>& xyz, std::uint32_t a, std::uint32_t b) {
  return std::hypot(static_cast<double>(xyz[3 * a]) - xyz[3 * b], static_cast<double>(xyz[3 * a + 1]) - xyz[3 * b + 1],
                    static_cast<double>(xyz[3 * a + 2]) - xyz[3 * b + 2]);
}

TEST_CASE("Every script tears the sheet in two, and its mesh is a manifold of the same area at every step", "[tearing]") {
  for (const auto name : tear_script_names()) {
    INFO(name);
    std::size_t cuts = 0;
    const TearingSheet sheet =
        tear(name, options_of(3), 1.0 / 60, [&](const TearingSheet& s, const TearAdvance& step, double) {
          if (!step.mesh_changed) return;
          ++cuts;
          const SheetMesh& mesh = *s.mesh();
          const Form form = form_of(mesh);
          REQUIRE(form.pieces == (s.separated() ? 2 : 1));
          REQUIRE(form.euler == static_cast<int>(form.pieces));  // discs
          REQUIRE(area_m2(mesh) == Approx(0.297 * 0.210).epsilon(1e-5));
          REQUIRE(form.border_m == Approx(2 * (0.297 + 0.210) + 2 * path_length_m(s.path_m())).epsilon(1e-5));
          REQUIRE(mesh.material_coordinates.size() == s.vertices().size());
        });
    CHECK(sheet.separated());
    CHECK(cuts > 20);
  }
}

TEST_CASE("The tear reaches the far edge for each of a hundred seeds", "[tearing]") {
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    INFO(seed);
    const auto sheet = tear("pulled", options_of(seed, 183), 1.0 / 60, [](const auto&, const auto&, double) {});
    REQUIRE(sheet.separated());
    CHECK(sheet.path_m().front().y == 0.210);
    CHECK(sheet.path_m().back().y == 0);
    const Form form = form_of(*sheet.mesh());
    CHECK(form.pieces == 2);
    CHECK(form.euler == 2);
  }
}

TEST_CASE("Both lips have their own vertices of the same material points, joined at the tip only", "[tearing]") {
  const auto script = make_tear_script("slow");
  auto sheet = TearingSheet::make(options_of(2));
  for (double t = 0; t < 3; t += 1.0 / 60) REQUIRE(sheet->advance(script->motions(*sheet, t, 1.0 / 60), 1.0 / 60));
  const auto& uv = sheet->mesh()->material_coordinates;
  std::map<std::array<float, 2>, int> copies;
  std::size_t left = 0, right = 0, tips = 0;
  for (std::size_t v = 0; v < uv.size(); ++v) {
    left += sheet->vertices()[v] == TornVertex::kLeftLip ? 1 : 0;
    right += sheet->vertices()[v] == TornVertex::kRightLip ? 1 : 0;
    tips += sheet->vertices()[v] == TornVertex::kTip ? 1 : 0;
    ++copies[uv[v]];
  }
  CHECK(tips == 1);
  CHECK(left == right);
  CHECK(left + tips == sheet->path_m().size());
  CHECK(static_cast<std::size_t>(std::count_if(copies.begin(), copies.end(), [](const auto& c) { return c.second == 2; })) ==
        left);
  // At the tear's beginning the lips are as far apart as the hands have turned.
  const auto xyz = positions_of(*sheet);
  const TearPose& pose = sheet->pose();
  const Point2 start = sheet->path_m().front();
  const double apart = length(pose.region(kLeft).at(start) - pose.region(kRight).at(start));
  std::vector<std::uint32_t> both;
  for (std::uint32_t v = 0; v < uv.size(); ++v) {
    if (std::abs(uv[v][0] - static_cast<float>(start.x)) < 1e-6f && std::abs(uv[v][1] - static_cast<float>(start.y)) < 1e-6f)
      both.push_back(v);
  }
  REQUIRE(both.size() == 2);
  CHECK(apart > 0.01);
  CHECK(distance(xyz, both[0], both[1]) == Approx(apart).epsilon(1e-3));
}

TEST_CASE("The torn sheet keeps its area in space, and no vertex jumps", "[tearing]") {
  for (const auto name : {"slow", "pulled", "one_handed"}) {
    INFO(name);
    constexpr double kStep_s = 1.0 / 120;
    std::map<std::pair<std::array<float, 2>, TornVertex>, std::array<float, 3>> before;
    double fastest = 0, least_area = 1, most_area = 0, highest = 0;
    tear(name, options_of(5, 1333), kStep_s, [&](const TearingSheet& s, const TearAdvance&, double) {
      const auto xyz = positions_of(s);
      const auto& mesh = *s.mesh();
      double area = 0;
      for (const auto& t : mesh.triangles) {
        const double a = distance(xyz, t[0], t[1]), b = distance(xyz, t[1], t[2]), c = distance(xyz, t[2], t[0]);
        const double h = (a + b + c) / 2;
        area += std::sqrt(std::max(0.0, h * (h - a) * (h - b) * (h - c)));
      }
      least_area = std::min(least_area, area);
      most_area = std::max(most_area, area);
      decltype(before) now;
      for (std::uint32_t v = 0; v < mesh.material_coordinates.size(); ++v) {
        const std::array<float, 3> p = {xyz[3 * v], xyz[3 * v + 1], xyz[3 * v + 2]};
        highest = std::max(highest, static_cast<double>(p[2]));
        REQUIRE(p[2] > -1e-6f);
        const auto key = std::pair{mesh.material_coordinates[v], s.vertices()[v]};
        if (const auto was = before.find(key); was != before.end()) {
          const auto& q = was->second;
          fastest = std::max(fastest, std::hypot(static_cast<double>(p[0]) - q[0], static_cast<double>(p[1]) - q[1],
                                                 static_cast<double>(p[2]) - q[2]) /
                                          kStep_s);
        }
        now.emplace(key, p);
      }
      before = std::move(now);
    });
    CHECK(least_area > 0.98 * 0.297 * 0.210);
    CHECK(most_area < 1.01 * 0.297 * 0.210);
    CHECK(fastest < 4);
    CHECK(highest > 0.02);
  }
}

TEST_CASE("The torn edge is the rougher the more the fibres lead it", "[tearing]") {
  const auto roughness = [](double stress_share) {
    double extra = 0;
    for (std::uint64_t seed = 1; seed <= 12; ++seed) {
      TearDetailOptions detail;
      detail.stress_share = stress_share;
      detail.seed = seed;
      TearPath path(RectangleSize{}, {0.15, 0.210}, detail);
      for (double y = 0.21; y > 0.03; y -= 0.0005) path.follow({path.start_m().x, y}, {0, -1});
      double square = 0;
      for (const Point2 p : path.points_m()) square += (p.x - path.start_m().x) * (p.x - path.start_m().x);
      extra += std::sqrt(square / static_cast<double>(path.points_m().size())) / 12;
    }
    return extra;
  };
  const double straight = roughness(1), little = roughness(0.3), more = roughness(0.1), most = roughness(0.01);
  CHECK(straight < 1e-4);
  CHECK(straight < little);
  CHECK(little < more);
  CHECK(more < most);
  CHECK(most > 5e-4);
}

TEST_CASE("The path follows the tip within a few texels and never touches itself", "[tearing]") {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    TearDetailOptions detail;
    detail.seed = seed;
    TearPath path(RectangleSize{}, {0.1, 0.210}, detail);
    Point2 tip = path.start_m();
    double heading = -1.57;
    for (int k = 0; k < 600; ++k) {  // half a turn
      heading += 3.0 / 600;
      tip = tip + 0.00035 * turned({1, 0}, heading);
      if (tip.y > 0.2 && k > 100) break;
      path.follow(tip, turned({1, 0}, heading));
      REQUIRE(length(path.points_m().back() - tip) < 0.006);
    }
    const auto points = path.points_m();
    CHECK(points.size() > 100);
    for (std::size_t a = 1; a < points.size(); ++a) {
      for (std::size_t b = a + 1; b < points.size(); ++b) {
        REQUIRE(length(points[a] - points[b]) > 0.98 * std::min(path.texel_m().x, path.texel_m().y));
      }
    }
  }
}

TEST_CASE("The same options and steps give the same bits, another seed another tear", "[tearing]") {
  const auto run = [](std::uint64_t seed) {
    return tear("fast", options_of(seed), 1.0 / 60, [](const auto&, const auto&, double) {});
  };
  const auto once = run(7), again = run(7), other = run(8);
  const auto a = positions_of(once), b = positions_of(again);
  REQUIRE(a.size() == b.size());
  CHECK(std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0);
  CHECK(once.mesh()->triangles == again.mesh()->triangles);
  CHECK_FALSE(std::equal(once.path_m().begin(), once.path_m().end(), other.path_m().begin(), other.path_m().end()));
}

TEST_CASE("Hands turn as far as the sheet lets them; what they do is told", "[tearing]") {
  auto sheet = TearingSheet::make(options_of(1));
  const auto small = sheet->advance({HandMotion{0.05}, HandMotion{0.05}}, 0.1);
  REQUIRE(small);
  CHECK(small->share == 1);
  CHECK(small->torn_m > 0);
  REQUIRE(sheet->tip());
  CHECK(sheet->tip()->speed_m_per_s == Approx(small->torn_m / 0.1));
  CHECK(sheet->tip()->direction[1] < -0.9);
  const auto large = sheet->advance({HandMotion{2}, HandMotion{2}}, 0.1);
  REQUIRE(large);
  CHECK(large->share < 0.99);
  CHECK_FALSE(sheet->separated());
  CHECK(sheet->pose().strain() <= 0.45);
  const auto back = sheet->advance({HandMotion{-3}, HandMotion{-3}}, 0.1);
  REQUIRE(back);
  CHECK(back->torn_m == 0);
  CHECK(sheet->pose().opening_rad() == Approx(0).margin(1e-12));
}

TEST_CASE("Arguments that make no sense are refused by name", "[tearing]") {
  const auto refused = [](const auto& change) {
    TearingOptions options;
    change(options);
    const auto made = TearingSheet::make(options);
    REQUIRE_FALSE(made);
    return made.error();
  };
  const auto nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(refused([](auto& o) { o.size.width_m = 0; }).find("size") == 0);
  CHECK(refused([&](auto& o) { o.size.height_m = nan; }).find("size") == 0);
  CHECK(refused([](auto& o) { o.triangles = 3; }).find("triangles") == 0);
  CHECK(refused([](auto& o) { o.stress_share = 1.5; }).find("stress_share") == 0);
  CHECK(refused([](auto& o) { o.torn_m_per_rad = 0; }).find("torn_m_per_rad") == 0);
  CHECK(refused([](auto& o) { o.texel_m = 0.1; }).find("texel_m") == 0);
  const auto grips = usual_grips({});
  CHECK(refused([&](auto& o) { o.grips = Grips{grips[kRight], grips[kLeft]}; }).find("grips") == 0);
  CHECK(refused([&](auto& o) { o.grips = Grips{grips[kLeft], Grip{{-1, 0}, {0.1, 0.1}}}; }).find("grips") == 0);
  CHECK(refused([&](auto& o) {
          o.grips = Grips{grips[kLeft], Grip{grips[kRight].thumb_m, grips[kRight].thumb_m}};
        }).find("grips") == 0);
  auto sheet = TearingSheet::make({});
  REQUIRE(sheet);
  CHECK_FALSE(sheet->advance({HandMotion{nan}, {}}, 0.1));
  CHECK_FALSE(sheet->advance({}, 0));
  CHECK(make_tear("sideways") == nullptr);
}

TEST_CASE("Fibres stand along both lips and stay as the tear goes on", "[tearing]") {
  auto sheet = TearingSheet::make(options_of(4));
  const auto script = make_tear_script("slow");
  double t = 0;
  const auto go_on = [&](double until_s) {
    for (; t < until_s; t += 1.0 / 60) REQUIRE(sheet->advance(script->motions(*sheet, t, 1.0 / 60), 1.0 / 60));
  };
  const auto key = [&](const TornFibre& f) {
    return std::tuple{sheet->mesh()->material_coordinates[f.from], sheet->vertices()[f.from], f.along, f.length_m,
                      f.splay_rad};
  };
  go_on(2);
  const auto early = sheet->fibres();
  REQUIRE_FALSE(early.empty());
  std::vector<decltype(key(early[0]))> kept;
  for (const auto& f : early) {
    if (sheet->vertices()[f.to] != TornVertex::kTip && sheet->vertices()[f.from] != TornVertex::kTip) kept.push_back(key(f));
    CHECK(f.length_m >= 0);
    CHECK(f.length_m < 0.002);
    CHECK((f.along >= 0 && f.along < 1));
  }
  go_on(4);
  const auto late = sheet->fibres();
  CHECK(late.size() == Approx(3000 * 2 * path_length_m(sheet->path_m())).epsilon(0.05));
  std::vector<decltype(key(early[0]))> then;
  for (const auto& f : late) then.push_back(key(f));
  std::sort(then.begin(), then.end());
  for (const auto& f : kept) CHECK(std::binary_search(then.begin(), then.end(), f));
}

TEST_CASE("Demos stream, those that are torn with new topologies and tips, the others as they are", "[tearing]") {
  CHECK(make_stream_demo("dance") == nullptr);
  const auto names = stream_demo_names();
  CHECK(std::find(names.begin(), names.end(), "tear") != names.end());
  const auto snap = make_stream_demo("snap", 446);
  const auto* first = snap->frame(0).mesh.get();
  CHECK(snap->frame(0.5).mesh.get() == first);
  CHECK_FALSE(snap->frame(0.6).fresh);
  const auto torn = make_stream_demo("tear", 446);
  CHECK(torn->on_table());
  CHECK(torn->frame(0).fresh);
  std::size_t topologies = 0, moving = 0;
  const SheetMesh* mesh = nullptr;
  for (double t = 0; t <= torn->duration_s(); t += 1.0 / 60) {
    const StreamedFrame& frame = torn->frame(t);
    REQUIRE(frame.xyz_m.size() == 3 * frame.mesh->material_coordinates.size());
    REQUIRE(frame.anchored.size() == frame.mesh->material_coordinates.size());
    topologies += frame.mesh.get() != mesh ? 1 : 0;
    mesh = frame.mesh.get();
    moving += !frame.tear_tips.empty() && frame.tear_tips[0].speed_m_per_s > 0 ? 1 : 0;
  }
  CHECK(topologies > 40);
  CHECK(moving > 60);
  CHECK(torn->frame(torn->duration_s()).tear_tips.empty());
}

}  // namespace

}  // namespace tearing_sheet_test
