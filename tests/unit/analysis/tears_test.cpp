#include "server/analysis/tears.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numeric>
#include <set>
#include <utility>
#include <vector>

#include <catch2/catch.hpp>

#include "moving_sheet.h"
#include "sound_db/dsp/random.h"

namespace tears_test {

using namespace rustle;
using observation::TearEvent;
using sheet::Vec3d;

namespace {

constexpr double kRate_hz = 60;
constexpr double kSide_m = 0.1;

struct Mesh {
  std::vector<sheet::Vec2f> uv;
  std::vector<sheet::Triangle> triangles;
};
using Edge = std::pair<std::uint32_t, std::uint32_t>;
using Cuts = std::set<Edge>;

Edge edge_of(std::uint32_t a, std::uint32_t b) {
  return {std::min(a, b), std::max(a, b)};
}

/// A square of n x n cells.
Mesh grid(std::uint32_t n, bool other_diagonals = false) {
  Mesh mesh;
  for (std::uint32_t i = 0; i <= n; ++i) {
    for (std::uint32_t j = 0; j <= n; ++j)
      mesh.uv.emplace_back(static_cast<float>(kSide_m * i / n), static_cast<float>(kSide_m * j / n));
  }
  for (std::uint32_t i = 0; i < n; ++i) {
    for (std::uint32_t j = 0; j < n; ++j) {
      const std::uint32_t a = i * (n + 1) + j, b = a + n + 1, c = b + 1, d = a + 1;
      if (other_diagonals) {
        mesh.triangles.push_back({a, b, d});
        mesh.triangles.push_back({b, c, d});
      } else {
        mesh.triangles.push_back({a, b, c});
        mesh.triangles.push_back({a, c, d});
      }
    }
  }
  return mesh;
}

/// Cut along a polyline of the grid's vertices, given in cells.
void cut(Cuts& cuts, std::uint32_t n, const std::vector<std::pair<std::uint32_t, std::uint32_t>>& path) {
  for (std::size_t k = 1; k < path.size(); ++k) {
    auto [i, j] = path[k - 1];
    const auto [to_i, to_j] = path[k];
    while (i != to_i || j != to_j) {
      const std::uint32_t from = i * (n + 1) + j;
      i = i < to_i ? i + 1 : i > to_i ? i - 1 : i;
      j = j < to_j ? j + 1 : j > to_j ? j - 1 : j;
      cuts.insert(edge_of(from, i * (n + 1) + j));
    }
  }
}

/// The mesh with vertices duplicated along its cut edges; new ones come last.
Mesh split(const Mesh& mesh, const Cuts& cuts) {
  std::map<Edge, std::vector<std::pair<std::size_t, std::uint32_t>>> sides;
  std::vector<std::uint32_t> parent(3 * mesh.triangles.size());
  std::iota(parent.begin(), parent.end(), 0u);
  const std::function<std::uint32_t(std::uint32_t)> find = [&](std::uint32_t c) {
    return parent[c] == c ? c : parent[c] = find(parent[c]);
  };
  const auto corner = [&](std::size_t f, std::uint32_t v) {
    const auto& t = mesh.triangles[f];
    return static_cast<std::uint32_t>(3 * f + (t[0] == v ? 0u : t[1] == v ? 1u : 2u));
  };
  std::map<Edge, std::size_t> first;
  for (std::size_t f = 0; f < mesh.triangles.size(); ++f) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = mesh.triangles[f][k], b = mesh.triangles[f][(k + 1) % 3];
      if (cuts.contains(edge_of(a, b))) continue;
      const auto [other, fresh] = first.try_emplace(edge_of(a, b), f);
      if (fresh) continue;
      for (const std::uint32_t v : {a, b}) parent[find(corner(f, v))] = find(corner(other->second, v));
    }
  }
  Mesh out{mesh.uv, mesh.triangles};
  std::map<std::uint32_t, std::uint32_t> names;
  std::vector<bool> taken(mesh.uv.size(), false);
  for (std::size_t f = 0; f < out.triangles.size(); ++f) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t v = mesh.triangles[f][k];
      const auto [name, fresh] = names.try_emplace(find(static_cast<std::uint32_t>(3 * f + k)), v);
      if (fresh && taken[v]) {
        name->second = static_cast<std::uint32_t>(out.uv.size());
        out.uv.push_back(mesh.uv[v]);
      }
      taken[v] = true;
      out.triangles[f][k] = name->second;
    }
  }
  return out;
}

/// The same with its vertices in another order.
Mesh renumbered(const Mesh& mesh, std::uint64_t seed, bool triangles_too) {
  std::vector<std::uint32_t> order(mesh.uv.size());
  std::iota(order.begin(), order.end(), 0u);
  dsp::Random random(seed);
  for (std::size_t k = order.size(); k > 1; --k) std::swap(order[k - 1], order[random.index(static_cast<std::uint32_t>(k))]);
  Mesh out{std::vector<sheet::Vec2f>(mesh.uv.size()), mesh.triangles};
  for (std::size_t v = 0; v < order.size(); ++v) out.uv[order[v]] = mesh.uv[v];
  for (auto& t : out.triangles) t = {order[t[0]], order[t[1]], order[t[2]]};
  if (triangles_too) {
    for (std::size_t k = out.triangles.size(); k > 1; --k)
      std::swap(out.triangles[k - 1], out.triangles[random.index(static_cast<std::uint32_t>(k))]);
  }
  return out;
}

enum class Told { kMaterial, kRest, kNothing };

std::shared_ptr<const sheet::Topology> topology_of(const Mesh& mesh, Told told) {
  sheet::Topology::Input input;
  input.vertex_count = mesh.uv.size();
  input.triangles = mesh.triangles;
  if (told == Told::kMaterial) input.material_coordinates_m = mesh.uv;
  if (told == Told::kRest) {
    for (const auto& p : mesh.uv) input.rest_positions_m.emplace_back(0.3f, p.x(), p.y());
  }
  return sheet::Topology::make(std::move(input)).value();
}

struct Run {
  std::vector<std::vector<TearEvent>> frames;

  double torn_m() const {
    double sum = 0;
    for (const auto& seen : frames) {
      for (const auto& tear : seen) sum += tear.speed_m_per_s / kRate_hz;
    }
    return sum;
  }
  std::set<std::uint64_t> ids() const {
    std::set<std::uint64_t> out;
    for (const auto& seen : frames) {
      for (const auto& tear : seen) out.insert(tear.id);
    }
    return out;
  }
  /// Of one frame, those that go on.
  std::vector<TearEvent> moving(std::size_t frame) const {
    std::vector<TearEvent> out;
    for (const auto& tear : frames[frame]) {
      if (tear.speed_m_per_s > 0) out.push_back(tear);
    }
    return out;
  }
};

/// Flat, gently curved and carried along.
Vec3d drifting(double u, double v, double time_s) {
  return {u + 0.3 * time_s, v - 0.1 * time_s, 0.05 * u * u + 0.2 * time_s};
}

using Place = std::function<Vec3d(double u, double v, double time_s)>;
Run run(const std::vector<Mesh>& meshes, Told told = Told::kMaterial, const Place& place = drifting) {
  analysis::SheetAnalyzer analyzer(1, {});
  std::uint64_t next_id = 1;
  Run out;
  for (std::size_t k = 0; k < meshes.size(); ++k) {
    sheet::MeshFrame frame;
    frame.sheet = 1;
    frame.time_s = static_cast<double>(k) / kRate_hz;
    frame.topology = topology_of(meshes[k], told);
    for (const auto& p : meshes[k].uv)
      frame.positions_m.push_back(place(static_cast<double>(p.x()), static_cast<double>(p.y()), frame.time_s).cast<float>());
    out.frames.push_back(analyzer.analyze(frame, {}, next_id).tears);
  }
  return out;
}

/// A straight cut from the middle of the lower side, a vertex further in every frame, until the sheet is in two.
std::vector<Mesh> straight_tear(std::uint32_t n) {
  std::vector<Mesh> out;
  for (std::uint32_t k = 0; k <= n; ++k) {
    Cuts cuts;
    cut(cuts, n, {{n / 2, 0}, {n / 2, k}});
    out.push_back(split(grid(n), cuts));
  }
  return out;
}

}  // namespace

TEST_CASE("a straight cut that grows vertex by vertex is one tip on its way, until it has left the sheet") {
  constexpr std::uint32_t kCells = 10;
  auto meshes = straight_tear(kCells);
  for (int k = 0; k < 3; ++k) meshes.push_back(meshes.back());
  for (const Told told : {Told::kMaterial, Told::kRest, Told::kNothing}) {
    const Run seen = run(meshes, told);
    CHECK(seen.frames[0].empty());
    CHECK(seen.ids().size() == 1);
    CHECK(seen.torn_m() == Approx(kSide_m).epsilon(0.01));
    for (std::uint32_t k = 1; k <= kCells; ++k) {
      REQUIRE(seen.frames[k].size() == 1);
      const TearEvent& tear = seen.frames[k][0];
      const Vec3d tip = drifting(kSide_m / 2, kSide_m * k / kCells, k / kRate_hz);
      CHECK((tear.position_m - tip).norm() < 1e-4);
      CHECK(tear.speed_m_per_s == Approx(kSide_m / kCells * kRate_hz).epsilon(0.02));
      CHECK(tear.torn_m == Approx(kSide_m * k / kCells).epsilon(0.02));
      CHECK(tear.direction.y() > 0.99);
      CHECK(tear.source == observation::Source::kDetected);
      REQUIRE(!tear.resonators.empty());
    }
    for (std::size_t k = kCells + 1; k < meshes.size(); ++k) CHECK(seen.frames[k].empty());
  }
}

TEST_CASE("a notch that is there from the first frame is silent, and where it grows only the growth counts") {
  const auto meshes = straight_tear(10);
  CHECK(run({meshes[4], meshes[4], meshes[4]}).ids().empty());
  const Run grown = run({meshes[4], meshes[4], meshes[6]});
  CHECK(grown.ids().size() == 1);
  CHECK(grown.torn_m() == Approx(0.02).epsilon(0.01));
}

TEST_CASE("a tip that waits stays where it is with speed 0, goes on under its id, and is a new one after its memory") {
  const auto meshes = straight_tear(10);
  std::vector<Mesh> slow{meshes[0], meshes[2]};
  for (int k = 0; k < 10; ++k) slow.push_back(meshes[2]);
  slow.push_back(meshes[4]);
  for (int k = 0; k < 30; ++k) slow.push_back(meshes[4]);
  slow.push_back(meshes[6]);
  const Run seen = run(slow);
  REQUIRE(seen.frames[5].size() == 1);
  CHECK(seen.frames[5][0].speed_m_per_s == 0);
  CHECK(seen.frames[5][0].id == seen.frames[1][0].id);
  CHECK(seen.frames[12][0].id == seen.frames[1][0].id);
  CHECK(seen.frames[12][0].torn_m == Approx(0.04).epsilon(0.01));
  CHECK(seen.frames[40].empty());
  REQUIRE(seen.frames.back().size() == 1);
  CHECK(seen.frames.back()[0].id != seen.frames[1][0].id);
  CHECK(seen.torn_m() == Approx(0.06).epsilon(0.01));
}

TEST_CASE("a cut and a remesh in one frame show the length of the cut") {
  std::vector<Mesh> meshes;
  for (std::uint32_t k = 0; k <= 5; ++k) {
    const std::uint32_t n = k % 3 == 0 ? 10 : k % 3 == 1 ? 20 : 30;
    Cuts cuts;
    cut(cuts, n, {{n / 2, 0}, {n / 2, n * k / 10}});
    meshes.push_back(split(grid(n, k % 2 == 1), cuts));
  }
  for (const Told told : {Told::kMaterial, Told::kRest}) {
    const Run seen = run(meshes, told);
    CHECK(seen.ids().size() == 1);
    CHECK(seen.torn_m() == Approx(0.05).epsilon(0.02));
    for (std::size_t k = 1; k < meshes.size(); ++k) {
      REQUIRE(seen.moving(k).size() == 1);
      const Vec3d tip = drifting(kSide_m / 2, 0.01 * static_cast<double>(k), static_cast<double>(k) / kRate_hz);
      CHECK((seen.moving(k)[0].position_m - tip).norm() < 1e-4);
    }
  }
}

TEST_CASE("remeshing at random makes no tear, straight or round, stretched or not") {
  std::vector<Mesh> rectangles, discs;
  for (std::uint64_t seed = 0; seed < 24; ++seed) {
    const auto made = sheets::make_rectangle(sheets::MeshKind::kDelaunay, 0.297, 0.210, 300 + 40 * (seed * 7 % 24), seed);
    Mesh mesh;
    for (const auto& uv : made.material_coordinates) mesh.uv.emplace_back(uv[0], uv[1]);
    mesh.triangles = made.triangles;
    rectangles.push_back(mesh);
    // The rectangle's border onto a circle, at other places each time.
    for (auto& p : mesh.uv) {
      const double x = 2 * static_cast<double>(p.x()) / 0.297 - 1, y = 2 * static_cast<double>(p.y()) / 0.210 - 1;
      const double r = std::max(std::abs(x), std::abs(y)), a = std::atan2(y, x);
      p = {static_cast<float>(0.1 * r * std::cos(a)), static_cast<float>(0.1 * r * std::sin(a))};
    }
    discs.push_back(mesh);
  }
  const Place stretched = [](double u, double v, double t) {
    return Vec3d(u * (1 + t), v * (1 - 0.5 * t), 0.1 * std::sin(20 * u));
  };
  for (const Told told : {Told::kMaterial, Told::kRest, Told::kNothing}) {
    CHECK(run(rectangles, told).ids().empty());
    CHECK(run(rectangles, told, stretched).ids().empty());
    CHECK(run(discs, told).ids().empty());
    CHECK(run(discs, told, stretched).ids().empty());
  }
}

TEST_CASE("stretch makes no tear, and does not change a tear's length") {
  const Place stretched = [](double u, double v, double t) { return Vec3d((1 + 2 * t) * u, (1 + 4 * t) * v, 0); };
  CHECK(run(std::vector<Mesh>(20, grid(10)), Told::kMaterial, stretched).ids().empty());
  CHECK(run(straight_tear(10), Told::kMaterial, stretched).torn_m() == Approx(kSide_m).epsilon(0.01));
}

TEST_CASE("two tips at once are two tears, a slit inside has two ends") {
  std::vector<Mesh> meshes;
  for (std::uint32_t k = 0; k <= 4; ++k) {
    Cuts cuts;
    cut(cuts, 12, {{3, 0}, {3, k}});
    cut(cuts, 12, {{9, 12}, {9, 12 - 2 * k}});
    meshes.push_back(split(grid(12), cuts));
  }
  const Run two = run(meshes);
  CHECK(two.ids().size() == 2);
  for (std::size_t k = 1; k < meshes.size(); ++k) {
    auto seen = two.moving(k);
    REQUIRE(seen.size() == 2);
    std::sort(seen.begin(), seen.end(), [](auto& a, auto& b) { return a.speed_m_per_s < b.speed_m_per_s; });
    CHECK(seen[0].direction.y() > 0.99);
    CHECK(seen[1].direction.y() < -0.99);
    CHECK(seen[1].speed_m_per_s == Approx(2 * seen[0].speed_m_per_s).epsilon(0.02));
  }
  Cuts short_slit, long_slit;
  cut(short_slit, 12, {{5, 6}, {7, 6}});
  cut(long_slit, 12, {{3, 6}, {9, 6}});
  const Run slit = run({grid(12), split(grid(12), short_slit), split(grid(12), long_slit)});
  CHECK(slit.ids().size() == 2);
  CHECK(slit.moving(2).size() == 2);
  CHECK(slit.torn_m() == Approx(6 * kSide_m / 12).epsilon(0.02));
}

TEST_CASE("a ragged tear has one tip, not one at every corner") {
  const std::vector<std::pair<std::uint32_t, std::uint32_t>> corners = {{5, 0}, {5, 2}, {7, 2}, {7, 4},
                                                                        {4, 4}, {4, 7}, {6, 7}};
  std::vector<Mesh> meshes;
  for (std::size_t k = 1; k <= corners.size(); k += 2) {
    Cuts cuts;
    cut(cuts, 10, {corners.begin(), corners.begin() + static_cast<std::ptrdiff_t>(k)});
    meshes.push_back(split(grid(10), cuts));
  }
  const Run seen = run(meshes);
  CHECK(seen.ids().size() == 1);
  for (std::size_t k = 1; k < meshes.size(); ++k) CHECK(seen.moving(k).size() == 1);
  CHECK(seen.torn_m() == Approx(14 * kSide_m / 10).epsilon(0.02));
}

TEST_CASE("a tear that branches goes on as one tip and begins another, straightest first") {
  Cuts trunk, branched;
  cut(trunk, 12, {{6, 0}, {6, 4}});
  cut(branched, 12, {{6, 0}, {6, 7}});
  cut(branched, 12, {{6, 4}, {3, 4}});
  const Run seen = run({grid(12), split(grid(12), trunk), split(grid(12), branched)});
  REQUIRE(seen.moving(1).size() == 1);
  REQUIRE(seen.moving(2).size() == 2);
  for (const TearEvent& tip : seen.moving(2)) {
    CHECK((tip.id == seen.moving(1)[0].id) == (tip.direction.y() > 0.8));
    CHECK(tip.speed_m_per_s == Approx(3 * kSide_m / 12 * kRate_hz).epsilon(0.1));
  }
  CHECK(seen.torn_m() == Approx(10 * kSide_m / 12).epsilon(0.02));
}

TEST_CASE("without material coordinates a cut is read off renumbered vertices too; renumbering and welding are silent") {
  const auto meshes = straight_tear(10);
  for (const bool triangles_too : {false, true}) {
    std::vector<Mesh> shuffled, joined;
    for (std::size_t k = 0; k < meshes.size(); ++k) {
      shuffled.push_back(renumbered(meshes[k], k, triangles_too));
      joined.push_back(renumbered(meshes[meshes.size() - 1 - k], k, triangles_too));
    }
    // Vertices are told by where they are only while they go less than a part of an edge.
    const Place slowly = [](double u, double v, double t) { return Vec3d(u + 0.05 * t, v, 0.05 * u * u); };
    const Run seen = run(shuffled, Told::kNothing, triangles_too ? slowly : Place(drifting));
    CHECK(seen.torn_m() == Approx(kSide_m).epsilon(0.02));
    CHECK(seen.ids().size() == 1);
    CHECK(run(joined, Told::kNothing).ids().empty());
    CHECK(run(joined, Told::kMaterial).ids().empty());
    std::vector<Mesh> only;
    for (std::uint64_t k = 0; k < 8; ++k) only.push_back(renumbered(meshes[5], k, triangles_too));
    CHECK(run(only, Told::kNothing).ids().empty());
    CHECK(run(only, Told::kMaterial).ids().empty());
  }
}

TEST_CASE("a sheet whose triangles all get vertices of their own is not torn") {
  Mesh apart;
  const Mesh whole = grid(10);
  for (const auto& t : whole.triangles) {
    const auto first = static_cast<std::uint32_t>(apart.uv.size());
    for (const std::uint32_t v : t) apart.uv.push_back(whole.uv[v]);
    apart.triangles.push_back({first, first + 1, first + 2});
  }
  for (const Told told : {Told::kMaterial, Told::kNothing}) {
    CHECK(run({whole, apart, apart}, told).ids().empty());
    CHECK(run({apart, whole, whole}, told).ids().empty());
  }
}

TEST_CASE("each of the two pieces rings by itself at the next tear") {
  auto meshes = straight_tear(10);
  Cuts both;
  cut(both, 10, {{5, 0}, {5, 10}});
  cut(both, 10, {{2, 0}, {2, 3}});
  meshes.push_back(split(grid(10), both));
  const Place bent = [](double u, double v, double) { return Vec3d(u, v, 4 * (v - 0.05) * (v - 0.05)); };
  const Run seen = run(meshes, Told::kMaterial, bent);
  const auto moving = seen.moving(meshes.size() - 1);
  REQUIRE(moving.size() == 1);
  double area_m2 = 0;
  for (const auto& resonator : moving[0].resonators) area_m2 += resonator.area_m2;
  CHECK(area_m2 == Approx(kSide_m * kSide_m / 2).epsilon(0.05));
}

TEST_CASE("tips that are sent replace what the mesh shows") {
  const auto meshes = straight_tear(10);
  analysis::SheetAnalyzer analyzer(1, {});
  std::uint64_t next_id = 1;
  for (std::size_t k = 0; k < meshes.size(); ++k) {
    sheet::MeshFrame frame;
    frame.time_s = static_cast<double>(k) / kRate_hz;
    frame.topology = topology_of(meshes[k], Told::kMaterial);
    for (const auto& p : meshes[k].uv) frame.positions_m.emplace_back(p.x(), p.y(), 0.0f);
    if (k < 6) frame.tear_tips.push_back({3, {0.02f, 0.03f, 0}, 0.5f, std::nullopt});
    const auto tears = analyzer.analyze(frame, {}, next_id).tears;
    REQUIRE(tears.size() == (k < 6 ? 1 : 0));
    if (k == 0) continue;
    if (k < 6) CHECK(tears[0].source == observation::Source::kSent);
    if (k < 6) CHECK(tears[0].torn_m == Approx(0.5 * static_cast<double>(k) / kRate_hz));
  }
}

}  // namespace tears_test
