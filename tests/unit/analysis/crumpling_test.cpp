#include "server/analysis/crumpling.h"

#include <algorithm>

#include <catch2/catch.hpp>

#include "client_sdk/sheets/motions.h"
#include "moving_sheet.h"

namespace crumpling_test {

using namespace rustle;
using observation::CrumplingEvent;
using sheets::MeshKind;

namespace {

constexpr double kArea_m2 = 0.297 * 0.210;

using MeshAt = std::function<std::pair<const sheets::SheetMesh*, std::shared_ptr<const sheet::Topology>>(int frame)>;
using MapAt = std::function<test::Map(double time_s)>;

struct Run {
  std::vector<CrumplingEvent> events;
  analysis::TopologyChanges changes;
};

Run run(const MeshAt& mesh_at, const MapAt& map_at, double duration_s, double frames_per_s) {
  analysis::SheetAnalyzer analyzer(1, {});
  std::uint64_t next_id = 1;
  Run out;
  for (int k = 0; k <= duration_s * frames_per_s; ++k) {
    const double time = k / frames_per_s;
    const auto [mesh, topology] = mesh_at(k);
    auto seen = analyzer.analyze(test::frame_of(*mesh, topology, map_at(time), time), {}, next_id);
    for (auto& e : seen.crumpling) out.events.push_back(std::move(e));
  }
  out.changes = analyzer.topology_changes();
  return out;
}

MeshAt always(const sheets::SheetMesh& mesh, bool material = true) {
  return [&mesh, topology = test::topology_of(mesh, material)](int) { return std::pair{&mesh, topology}; };
}

std::size_t chains(const std::vector<CrumplingEvent>& events) {
  std::size_t n = 0;
  for (const auto& e : events) n += e.continues == 0;
  return n;
}

/// κ from +k to -k between start and start + duration, linear.
MapAt reversal(double k, double start_s, double duration_s) {
  return [=](double t) { return test::arc(k * (1 - 2 * std::clamp((t - start_s) / duration_s, 0.0, 1.0))); };
}

}  // namespace

TEST_CASE("a rigid motion makes no event, whatever the bend, the resolution and the place") {
  for (std::size_t triangles : {183, 1333, 20000}) {
    const auto mesh = sheets::make_rectangle(MeshKind::kDelaunay, 0.297, 0.210, triangles);
    for (double curvature : {0.0, 0.2, 0.7, 6.0}) {
      const auto map_at = [&](double t) {
        const Eigen::Quaterniond turn(Eigen::AngleAxisd(7 * t, sheet::Vec3d(1, -1, 2).normalized()));
        return test::moved(test::arc(curvature), turn, {10 + 2 * t, -3 * t, 1 + t});
      };
      CAPTURE(triangles, curvature);
      CHECK(run(always(mesh), map_at, triangles > 10000 ? 0.3 : 1.0, 60).events.empty());
    }
  }
}

TEST_CASE("a reversal is one event, dated and sized as the formula says, at every size, triangulation and rate") {
  const double k = 5, start = 0.1063, duration = 5.5 / 60;
  for (MeshKind kind : {MeshKind::kStructured, MeshKind::kDelaunay, MeshKind::kGraded}) {
    for (std::size_t triangles : {183, 446, 1333, 5000}) {
      const auto mesh = sheets::make_rectangle(kind, 0.297, 0.210, triangles);
      for (double rate : {60.0, 120.0, 240.0}) {
        const Run r = run(always(mesh), reversal(k, start, duration), 0.4, rate);
        CAPTURE(static_cast<int>(kind), triangles, rate);
        REQUIRE(r.events.size() >= 1);
        CHECK(chains(r.events) == 1);
        const auto& e = r.events[0];
        CHECK(e.time_s == Approx(start + duration / 2).margin(1e-3));
        CHECK(e.direction == -1);
        CHECK(e.area_m2 == Approx(kArea_m2).epsilon(0.1));
        const auto h = [&](double t) { return k / 2 * (1 - 2 * std::clamp((t - start) / duration, 0.0, 1.0)); };
        double expected = 0, total = 0;
        for (const auto& event : r.events) {
          expected += event.area_m2 * std::abs(h(event.confirmed_s) - h(event.confirmed_s - 1 / 30.0));
          total += event.amplitude_m;
        }
        CHECK(total == Approx(expected).epsilon(0.06));
        CHECK(e.continues == 0);
        for (std::size_t i = 1; i < r.events.size(); ++i) CHECK(r.events[i].continues != 0);
        CHECK(e.id == 1);
        CHECK(e.vertices.size() > 0.85 * static_cast<double>(mesh.material_coordinates.size()));
      }
    }
  }
}

TEST_CASE("a whole snap within a frame has the amplitude area times curvature") {
  const double k = 8;
  const auto mesh = sheets::make_rectangle(MeshKind::kDelaunay, 0.297, 0.210, 1333);
  const Run r = run(
      always(mesh), [&](double t) { return test::arc(t < 0.208 ? k : -k); }, 0.4, 60);
  REQUIRE(r.events.size() == 1);
  CHECK(r.events[0].amplitude_m == Approx(kArea_m2 * k).epsilon(0.05));
  CHECK(r.events[0].published_amplitude_per_m ==
        Approx(k * static_cast<double>(mesh.material_coordinates.size())).epsilon(0.05));
  CHECK(r.events[0].time_s == Approx(0.208).margin(1.0 / 180));
  CHECK(r.events[0].confirmed_s == Approx(13 / 60.0));
}

TEST_CASE("the procedural reversal of the sheets library is heard once, when its bend vanishes") {
  sheets::ReversalOptions options;
  const auto sheet = sheets::make_reversal(sheets::make_rectangle(MeshKind::kDelaunay, 0.297, 0.210, 1333), options);
  const auto topology = test::topology_of(sheet->mesh());
  analysis::SheetAnalyzer analyzer(1, {});
  std::uint64_t next_id = 1;
  std::vector<CrumplingEvent> events;
  std::vector<float> xyz(3 * sheet->mesh().material_coordinates.size());
  for (int k = 0; k < sheet->duration_s() * 60; ++k) {
    sheet::MeshFrame frame;
    frame.time_s = k / 60.0;
    frame.topology = topology;
    sheet->positions(frame.time_s, xyz);
    for (std::size_t i = 0; i < xyz.size(); i += 3) frame.positions_m.emplace_back(xyz[i], xyz[i + 1], xyz[i + 2]);
    for (auto& e : analyzer.analyze(frame, {}, next_id).crumpling) events.push_back(std::move(e));
  }
  REQUIRE(!events.empty());
  CHECK(chains(events) == 1);
  CHECK(events[0].time_s == Approx(options.zero_time_s()).margin(1e-3));
}

TEST_CASE("the same frames give the same bits") {
  const auto mesh = sheets::make_rectangle(MeshKind::kDelaunay, 0.297, 0.210, 446);
  const Run a = run(always(mesh), reversal(5, 0.1, 0.09), 0.3, 60), b = run(always(mesh), reversal(5, 0.1, 0.09), 0.3, 60);
  REQUIRE(a.events.size() == b.events.size());
  for (std::size_t i = 0; i < a.events.size(); ++i) {
    CHECK(a.events[i].time_s == b.events[i].time_s);
    CHECK(a.events[i].amplitude_m == b.events[i].amplitude_m);
    CHECK(a.events[i].resonators.size() == b.events[i].resonators.size());
    CHECK(a.events[i].resonators[0].ruling_length_m == b.events[i].resonators[0].ruling_length_m);
  }
}

TEST_CASE("a remesh of a fixed shape makes no event; a snap across one does") {
  std::vector<sheets::SheetMesh> meshes;
  std::vector<std::shared_ptr<const sheet::Topology>> topologies;
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    meshes.push_back(sheets::make_rectangle(MeshKind::kDelaunay, 0.297, 0.210, 700 + 60 * (seed % 5), seed));
    topologies.push_back(test::topology_of(meshes.back()));
  }
  const MeshAt remeshed = [&](int k) {
    const auto i = static_cast<std::size_t>(k) % meshes.size();
    return std::pair{&meshes[i], topologies[i]};
  };
  for (const char* name :
       {"flat", "strip10", "strip30_oblique", "cone", "sbend", "sbend_oblique", "half_bent", "ridge", "bent_ridge"}) {
    const auto& shape = *sheets::find_shape(name);
    CAPTURE(name);
    const Run r = run(
        remeshed, [&](double) { return test::map_of(*shape.shape); }, 0.5, 60);
    CHECK(r.events.empty());
    CHECK(r.changes.by_material == 30);
  }
  const Run snap = run(
      remeshed, [](double t) { return test::arc(t < 0.208 ? 6.0 : -6.0); }, 0.4, 60);
  REQUIRE(snap.events.size() == 1);
  CHECK(snap.events[0].amplitude_m == Approx(kArea_m2 * 6).epsilon(0.1));
}

TEST_CASE("without material coordinates an unknown mesh at every frame is silent, and said to be") {
  std::vector<sheets::SheetMesh> meshes;
  std::vector<std::shared_ptr<const sheet::Topology>> topologies;
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    meshes.push_back(sheets::make_rectangle(MeshKind::kDelaunay, 0.297, 0.210, 700, seed));
    topologies.push_back(test::topology_of(meshes.back(), false));
  }
  const MeshAt remeshed = [&](int k) {
    const auto i = static_cast<std::size_t>(k) % meshes.size();
    return std::pair{&meshes[i], topologies[i]};
  };
  const Run r = run(remeshed, reversal(5, 0.1, 0.09), 0.3, 60);
  CHECK(r.events.empty());
  CHECK(r.changes.history_lost == 18);
}

TEST_CASE("a renumbered sheet loses nothing: the reversal is heard across the change") {
  const auto mesh = sheets::make_rectangle(MeshKind::kDelaunay, 0.297, 0.210, 446);
  const auto n = static_cast<std::uint32_t>(mesh.material_coordinates.size());
  auto other = mesh;
  for (std::uint32_t i = 0; i < n; ++i) other.material_coordinates[n - 1 - i] = mesh.material_coordinates[i];
  for (auto& t : other.triangles) {
    for (auto& v : t) v = n - 1 - v;
  }
  const auto a = test::topology_of(mesh, false), b = test::topology_of(other, false);
  const MeshAt renumbered = [&](int k) {
    return k % 2 == 0 ? std::pair{&mesh, a} : std::pair{const_cast<const sheets::SheetMesh*>(&other), b};
  };
  const Run r = run(renumbered, reversal(5, 0.1063, 0.09), 0.4, 60);
  CHECK(r.changes.history_lost == 0);
  CHECK(r.changes.by_position > 10);
  REQUIRE(r.events.size() >= 1);
  CHECK(chains(r.events) == 1);
  CHECK(r.events[0].time_s == Approx(0.1063 + 0.045).margin(1e-3));
}

TEST_CASE("history reset and a step back in time forget: a reversal between is not heard") {
  const auto mesh = sheets::make_rectangle(MeshKind::kStructured, 0.297, 0.210, 446);
  const auto topology = test::topology_of(mesh);
  for (bool reset : {true, false}) {
    analysis::SheetAnalyzer analyzer(1, {});
    std::uint64_t next_id = 1;
    CHECK(analyzer.analyze(test::frame_of(mesh, topology, test::arc(5), 1.0), {}, next_id).crumpling.empty());
    auto frame = test::frame_of(mesh, topology, test::arc(-5), reset ? 1.02 : 0.5);
    frame.reset_history = reset;
    const auto seen = analyzer.analyze(frame, {}, next_id);
    CHECK(seen.crumpling.empty());
    CHECK(seen.previous_time_s == frame.time_s);
    frame = test::frame_of(mesh, topology, test::arc(5), frame.time_s + 0.02);
    CHECK(analyzer.analyze(frame, {}, next_id).crumpling.size() == 1);
  }
}

TEST_CASE("the event's velocity is that of the sheet there, sent or differenced") {
  const auto mesh = sheets::make_rectangle(MeshKind::kStructured, 0.297, 0.210, 446);
  const auto topology = test::topology_of(mesh);
  for (bool sent : {true, false}) {
    analysis::SheetAnalyzer analyzer(1, {});
    std::uint64_t next_id = 1;
    const auto still = Eigen::Quaterniond::Identity();
    (void)analyzer.analyze(test::frame_of(mesh, topology, test::moved(test::arc(5), still, {0, 0, 0}), 0), {}, next_id);
    auto frame = test::frame_of(mesh, topology, test::moved(test::arc(-5), still, {0, 0.02, 0}), 0.01);
    if (sent) frame.velocities_m_per_s.assign(frame.positions_m.size(), sheet::Vec3f(0, 2, 0));
    const auto seen = analyzer.analyze(frame, {}, next_id);
    REQUIRE(seen.crumpling.size() == 1);
    CHECK(seen.crumpling[0].velocity_m_per_s.y() == Approx(2).epsilon(1e-3));
  }
}

}  // namespace crumpling_test
