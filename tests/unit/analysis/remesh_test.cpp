#include <algorithm>
#include <cmath>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <catch2/catch.hpp>

#include "moving_sheet.h"

namespace remesh_test {

using namespace rustle;
using observation::CrumplingEvent;
using sheets::MeshKind;

namespace {

constexpr double kWidth_m = 0.297;
constexpr double kHeight_m = 0.210;

/// A mesh and what it is made of.
struct Meshed {
  sheets::SheetMesh mesh;
  std::shared_ptr<const sheet::Topology> topology;
};

Meshed meshed(sheets::SheetMesh mesh, bool with_material = true) {
  auto topology = test::topology_of(mesh, with_material);
  return {std::move(mesh), std::move(topology)};
}

/// Random meshes of a rectangle, sizes within ± 15 %.
std::vector<Meshed> remeshes(double width_m, double height_m, std::size_t triangles, std::size_t count,
                             bool with_material = true) {
  std::vector<Meshed> out;
  for (std::uint64_t seed = 0; seed < count; ++seed) {
    const std::size_t size = triangles * (85 + 30 * (seed * 7 % count) / count) / 100;
    out.push_back(meshed(sheets::make_rectangle(MeshKind::kDelaunay, width_m, height_m, size, seed), with_material));
  }
  return out;
}

struct Run {
  std::vector<CrumplingEvent> events;
  analysis::TopologyChanges changes;
};

/// Frame k shows mesh k of the cycle.
template <class MapAt>
Run run(const std::vector<Meshed>& cycle, const MapAt& map_at, int frames, double rate_hz = 60) {
  analysis::SheetAnalyzer analyzer(1, {});
  std::uint64_t next_id = 1;
  Run out;
  for (int k = 0; k < frames; ++k) {
    const Meshed& now = cycle[static_cast<std::size_t>(k) % cycle.size()];
    const double time_s = k / rate_hz;
    auto seen = analyzer.analyze(test::frame_of(now.mesh, now.topology, map_at(time_s), time_s), {}, next_id);
    for (auto& event : seen.crumpling) out.events.push_back(std::move(event));
  }
  out.changes = analyzer.topology_changes();
  return out;
}

std::size_t beginnings(const std::vector<CrumplingEvent>& events) {
  return static_cast<std::size_t>(
      std::count_if(events.begin(), events.end(), [](const auto& event) { return event.continues == 0; }));
}

/// κ from +k to -k, linear.
auto reversal(double curvature_per_m, double start_s, double duration_s) {
  return [=](double t) { return test::arc(curvature_per_m * (1 - 2 * std::clamp((t - start_s) / duration_s, 0.0, 1.0))); };
}

/// Two halves of a rectangle side by side, joined along u = width/2 where v > crack_m, each with its own vertices below.
Meshed cracked(std::size_t triangles_per_half, double crack_m, std::uint64_t seed) {
  sheets::SheetMesh both = sheets::make_rectangle(MeshKind::kDelaunay, kWidth_m / 2, kHeight_m, triangles_per_half, seed);
  const auto first = static_cast<std::uint32_t>(both.material_coordinates.size());
  const auto right = sheets::make_rectangle(MeshKind::kDelaunay, kWidth_m / 2, kHeight_m, triangles_per_half, seed + 1000);
  const auto middle = static_cast<float>(kWidth_m / 2);
  std::vector<std::uint32_t> number(right.material_coordinates.size());
  for (std::size_t i = 0; i < number.size(); ++i) {
    const auto [u, v] = right.material_coordinates[i];
    number[i] = sheet::kNone;
    for (std::uint32_t j = 0; u == 0 && static_cast<double>(v) > crack_m && j < first; ++j) {
      const auto& other = both.material_coordinates[j];
      if (other[0] == middle && std::abs(other[1] - v) < 1e-6f) number[i] = j;
    }
    if (number[i] != sheet::kNone) continue;
    number[i] = static_cast<std::uint32_t>(both.material_coordinates.size());
    both.material_coordinates.push_back({u + middle, v});
  }
  for (const auto& t : right.triangles) both.triangles.push_back({number[t[0]], number[t[1]], number[t[2]]});
  return meshed(std::move(both));
}

/// Flat but for a flap where v < hinge_v.
test::Map flap(double curvature_per_m, double hinge_v) {
  return [=](double u, double v) {
    const double s = std::max(0.0, hinge_v - v), k = curvature_per_m;
    return sheet::Vec3d(u, std::max(v, hinge_v) - std::sin(k * s) / k, (std::cos(k * s) - 1) / k);
  };
}

/// Which half each vertex belongs to, from its triangles; joined vertices count as left.
std::vector<bool> right_half(const sheets::SheetMesh& mesh) {
  std::vector<bool> right(mesh.material_coordinates.size(), false);
  for (const auto& t : mesh.triangles) {
    float u = 0;
    for (const auto v : t) u += mesh.material_coordinates[v][0] / 3;
    for (const auto v : t) right[v] = right[v] || u > static_cast<float>(kWidth_m / 2);
  }
  return right;
}

/// Every triangle corner a vertex of its own along a line u = seam_m: welded and not.
sheets::SheetMesh split_along(const sheets::SheetMesh& mesh, float seam_m) {
  sheets::SheetMesh out = mesh;
  std::vector<std::uint32_t> twin(mesh.material_coordinates.size(), sheet::kNone);
  for (auto& t : out.triangles) {
    float u = 0;
    for (const auto v : t) u += mesh.material_coordinates[v][0] / 3;
    if (u < seam_m) continue;
    for (auto& v : t) {
      const bool shared = std::any_of(mesh.triangles.begin(), mesh.triangles.end(), [&](const auto& other) {
        float other_u = 0;
        for (const auto w : other) other_u += mesh.material_coordinates[w][0] / 3;
        return other_u < seam_m && std::find(other.begin(), other.end(), v) != other.end();
      });
      if (!shared) continue;
      if (twin[v] == sheet::kNone) {
        twin[v] = static_cast<std::uint32_t>(out.material_coordinates.size());
        out.material_coordinates.push_back(mesh.material_coordinates[v]);
      }
      v = twin[v];
    }
  }
  return out;
}

sheets::SheetMesh renumbered(const sheets::SheetMesh& mesh, std::uint32_t factor) {
  const auto n = static_cast<std::uint32_t>(mesh.material_coordinates.size());
  std::vector<std::uint32_t> order(n);
  for (std::uint32_t i = 0; i < n; ++i) order[i] = i;
  for (std::uint32_t i = n; i-- > 1;) std::swap(order[i], order[(factor * (i + 1) + 12345u) % (i + 1)]);
  sheets::SheetMesh out = mesh;
  for (std::uint32_t i = 0; i < n; ++i) out.material_coordinates[order[i]] = mesh.material_coordinates[i];
  for (auto& t : out.triangles) {
    for (auto& v : t) v = order[v];
  }
  std::rotate(out.triangles.begin(), out.triangles.begin() + 7, out.triangles.end());
  return out;
}

}  // namespace

TEST_CASE("a random remesh at every frame of any fixed sheet makes no event", "[remesh]") {
  for (const sheets::NamedShape& shape : sheets::shape_zoo()) {
    const bool dog_ear = shape.name == "dogear";
    for (const std::size_t triangles : {183, 446, 1333}) {
      const auto cycle = remeshes(shape.width_m, shape.height_m, triangles, dog_ear ? 24 : triangles > 1000 ? 8 : 16);
      const std::size_t remeshed = 2 * cycle.size();
      const Run r = run(
          cycle, [&](double) { return test::map_of(*shape.shape); }, static_cast<int>(remeshed) + 1);
      std::set<double> heard_s;  // remeshes that made an event
      for (const auto& event : r.events) heard_s.insert(event.confirmed_s);
      CAPTURE(shape.name, triangles, remeshed);
      CHECK(r.changes.by_material == remeshed);
      if (dog_ear) {
        CHECK(10 * heard_s.size() < remeshed);
      } else {
        CHECK(heard_s.size() == 0);
      }
    }
  }
}

TEST_CASE("remeshes between sizes, fine and coarse, of a fixed sheet make no event", "[remesh]") {
  for (const char* name : {"flat", "strip30_oblique", "cone", "sbend_oblique", "half_bent", "folded"}) {
    const sheets::NamedShape& shape = *sheets::find_shape(name);
    std::vector<Meshed> cycle;
    for (const std::size_t triangles : {446, 5000, 700, 183, 1333, 300}) {
      cycle.push_back(
          meshed(sheets::make_rectangle(MeshKind::kDelaunay, shape.width_m, shape.height_m, triangles, triangles)));
    }
    const Run r = run(
        cycle, [&](double) { return test::map_of(*shape.shape); }, 13);
    CAPTURE(name);
    CHECK(r.events.size() == 0);
  }
}

TEST_CASE("a snap is heard across remeshes at every frame", "[remesh]") {
  for (const std::size_t triangles : {446, 1333}) {
    const auto cycle = remeshes(kWidth_m, kHeight_m, triangles, 10);
    CAPTURE(triangles);
    const Run snap = run(
        cycle, [](double t) { return test::arc(t < 0.208 ? 6.0 : -6.0); }, 24);
    REQUIRE(snap.events.size() == 1);
    CHECK(snap.events[0].direction == -1);
    CHECK(snap.events[0].amplitude_m == Approx(kWidth_m * kHeight_m * 6).epsilon(0.1));
  }
}

TEST_CASE("signs are not carried across a crack", "[remesh]") {
  const double flap_m = 0.126;
  for (const double crack_m : {0.14, kHeight_m}) {  // halfway, and all through
    std::vector<Meshed> remeshed, reordered;
    for (std::uint64_t k = 0; k < 8; ++k) {
      remeshed.push_back(cracked(600, crack_m, k));
      reordered.push_back(meshed(renumbered(remeshed[0].mesh, static_cast<std::uint32_t>(2 * k + 7))));
    }
    for (const auto* cycle : {&remeshed, &reordered}) {
      const auto frame_of = [&](int k, double right_curvature_per_m) {
        const Meshed& now = (*cycle)[static_cast<std::size_t>(k) % cycle->size()];
        auto frame = test::frame_of(now.mesh, now.topology, flap(8, flap_m), k / 60.0);
        const auto right = right_half(now.mesh);
        const auto map = flap(right_curvature_per_m, flap_m);
        for (std::size_t i = 0; i < right.size(); ++i) {
          const auto [u, v] = now.mesh.material_coordinates[i];
          if (right[i]) frame.positions_m[i] = map(static_cast<double>(u), static_cast<double>(v)).cast<float>();
        }
        return frame;
      };
      CAPTURE(crack_m, cycle == &remeshed);
      analysis::SheetAnalyzer analyzer(1, {});
      std::uint64_t next_id = 1;
      for (int k = 0; k < 24; ++k) CHECK(analyzer.analyze(frame_of(k, -8), {}, next_id).crumpling.empty());
      const auto snap = analyzer.analyze(frame_of(24, 8), {}, next_id).crumpling;  // the right flap alone
      REQUIRE(snap.size() == 1);
      CHECK(snap[0].direction == 1);
      CHECK(snap[0].area_m2 == Approx(flap_m * kWidth_m / 2).epsilon(0.15));
    }
  }
}

TEST_CASE("renumbered and welded vertices are recognised, with and without material coordinates", "[remesh]") {
  const auto mesh = sheets::make_rectangle(MeshKind::kDelaunay, kWidth_m, kHeight_m, 446);
  const auto split = split_along(mesh, 0.15f);
  REQUIRE(split.material_coordinates.size() > mesh.material_coordinates.size() + 5);
  for (const bool material : {true, false}) {
    const std::vector<std::pair<std::string, std::vector<Meshed>>> cycles = {
        {"renumbered",
         {meshed(mesh, material), meshed(renumbered(mesh, 7), material), meshed(renumbered(mesh, 31), material)}},
        {"welded", {meshed(mesh, material), meshed(split, material)}},
        {"both", {meshed(split, material), meshed(renumbered(mesh, 7), material), meshed(renumbered(split, 5), material)}}};
    for (const auto& [name, cycle] : cycles) {
      CAPTURE(name, material);
      const Run still = run(
          cycle, [](double) { return test::arc(5); }, 30);
      CHECK(still.events.empty());
      const Run r = run(cycle, reversal(5, 0.1063, 0.09), 30);
      const Run plain = run({meshed(mesh, material)}, reversal(5, 0.1063, 0.09), 30);
      CHECK(r.changes.history_lost == 0);
      CHECK(beginnings(r.events) == 1);
      REQUIRE(!r.events.empty());
      CHECK(r.events[0].time_s == Approx(plain.events[0].time_s).margin(1e-3));
      double amplitude_m = 0, plain_m = 0;
      for (const auto& event : r.events) amplitude_m += event.amplitude_m;
      for (const auto& event : plain.events) plain_m += event.amplitude_m;
      CHECK(amplitude_m == Approx(plain_m).epsilon(0.2));
    }
  }
}

TEST_CASE("vertices of a renumbered mesh are where they come from", "[remesh]") {
  const auto mesh = sheets::make_rectangle(MeshKind::kDelaunay, kWidth_m, kHeight_m, 446);
  for (const bool material : {true, false}) {
    const Meshed before = meshed(mesh, material), after = meshed(renumbered(mesh, 7), material);
    analysis::SheetAnalyzer analyzer(1, {});
    std::uint64_t next_id = 1;
    std::vector<std::uint32_t> origins;
    for (int k = 0; k < 3; ++k) {
      const Meshed& now = k < 2 ? before : after;
      origins = analyzer.analyze(test::frame_of(now.mesh, now.topology, test::arc(5), k / 60.0), {}, next_id).origins;
      if (k < 2) CHECK(origins.empty());
    }
    REQUIRE(origins.size() == after.mesh.material_coordinates.size());
    for (std::size_t v = 0; v < origins.size(); ++v)
      CHECK(after.mesh.material_coordinates[v] == before.mesh.material_coordinates[origins[v]]);
  }
}

TEST_CASE("a mesh that is new at every frame, without material coordinates, is silent, and counted", "[remesh]") {
  for (const std::size_t triangles : {183, 1333}) {
    const auto cycle = remeshes(kWidth_m, kHeight_m, triangles, 6, false);
    CAPTURE(triangles);
    for (const auto& shape : {"flat", "strip10", "cone", "ridge"}) {
      CAPTURE(shape);
      CHECK(run(
                cycle, [&](double) { return test::map_of(*sheets::find_shape(shape)->shape); }, 13)
                .events.empty());
    }
    const Run r = run(cycle, reversal(5, 0.1, 0.09), 19);
    CHECK(r.events.empty());
    CHECK(r.changes.history_lost == 18);
  }
}

}  // namespace remesh_test
