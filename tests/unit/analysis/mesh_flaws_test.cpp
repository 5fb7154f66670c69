#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include "client_sdk/sheets/known_regions.h"
#include "moving_sheet.h"
#include "server/scene/scene_state.h"

namespace mesh_flaws_test {

using namespace rustle;
using observation::Observation;
using observation::Resonator;
using sheet::Vec3d;
using sheet::Vec3f;
using sheets::MeshKind;
using sheets::SheetMesh;

namespace {

bool finite(const Resonator& r) {
  return std::isfinite(r.ruling_length_m) && std::isfinite(r.free_border_length_m) && std::isfinite(r.area_m2) &&
         r.position_m.allFinite() && r.normal.allFinite() && std::isfinite(r.normal_spread) && r.covariance_m2.allFinite() &&
         std::isfinite(r.disc_radius_m);
}

bool finite(const Observation& seen) {
  const auto all = [](const std::vector<Resonator>& resonators) {
    return std::all_of(resonators.begin(), resonators.end(), [](const auto& r) { return finite(r); });
  };
  for (const auto& e : seen.crumpling) {
    if (!std::isfinite(e.time_s) || !std::isfinite(e.amplitude_m) || !std::isfinite(e.published_amplitude_per_m) ||
        !std::isfinite(e.area_m2) || !e.position_m.allFinite() || !e.velocity_m_per_s.allFinite() || !all(e.resonators)) {
      return false;
    }
  }
  for (const auto& c : seen.friction) {
    if (!std::isfinite(c.speed_m_per_s) || !std::isfinite(c.area_m2) || !c.position_m.allFinite() ||
        !c.direction.allFinite() || !all(c.resonators)) {
      return false;
    }
    for (const auto& v : c.vertices) {
      if (!v.slip_velocity_m_per_s.allFinite() || !std::isfinite(v.area_m2)) return false;
    }
  }
  for (const auto& t : seen.tears) {
    if (!t.position_m.allFinite() || !t.direction.allFinite() || !all(t.resonators)) return false;
  }
  return true;
}

struct Heard {
  std::size_t events = 0, contacts = 0;
};

/// Bends, snaps and slides the mesh over a table with an anchor and a tear tip; everything that comes out is finite.
Heard exercise(const std::shared_ptr<const sheet::Topology>& topology,
               const std::function<Vec3f(std::size_t vertex, const test::Map& map)>& place) {
  const auto scene = test::table_at_zero();
  analysis::SheetSurroundings surroundings;
  surroundings.scene = &scene;
  analysis::SheetAnalyzer analyzer(1, {});
  std::uint64_t next_id = 1;
  Heard heard;
  for (int k = 0; k < 14; ++k) {
    sheet::MeshFrame frame;
    frame.sheet = 1;
    frame.time_s = k / 60.0;
    frame.topology = topology;
    const auto map = test::moved(test::arc(k % 6 < 3 ? 6 : -6), Eigen::Quaterniond::Identity(), {0.002 * k, 0, 0.1});
    for (std::size_t i = 0; i < topology->vertex_count(); ++i) frame.positions_m.push_back(place(i, map));
    if (k > 7) {
      for (auto& p : frame.positions_m) p.z() = 0.001f + 0.001f * std::sin(40 * p.x());
    }
    frame.anchored.assign(topology->vertex_count(), false);
    if (topology->vertex_count() > 3) frame.anchored[3] = true;
    frame.tear_tips.push_back({1, Vec3f(0.01f, 0.1f, 0.1f), 0.1f, std::nullopt});
    const Observation seen = analyzer.analyze(frame, surroundings, next_id);
    CAPTURE(k);
    CHECK(finite(seen));
    for (const auto& region : analysis::picture_regions(frame, {}).regions) CHECK(finite(region));
    heard.events += seen.crumpling.size();
    heard.contacts += seen.friction.size();
  }
  return heard;
}

std::shared_ptr<const sheet::Topology> topology_of(const SheetMesh& mesh, std::vector<sheet::Triangle> more = {},
                                                   std::size_t unused = 0, bool with_material = true) {
  sheet::Topology::Input input;
  input.vertex_count = mesh.material_coordinates.size() + unused;
  input.triangles = mesh.triangles;
  input.triangles.insert(input.triangles.end(), more.begin(), more.end());
  for (std::size_t i = 0; with_material && i < input.vertex_count; ++i) {
    const auto uv = i < mesh.material_coordinates.size() ? mesh.material_coordinates[i] : std::array<float, 2>{7, 7};
    input.material_coordinates_m.emplace_back(uv[0], uv[1]);
  }
  return sheet::Topology::make(std::move(input)).value();
}

Heard exercise(const SheetMesh& mesh, const std::shared_ptr<const sheet::Topology>& topology) {
  return exercise(topology, [&](std::size_t i, const test::Map& map) -> Vec3f {
    if (i >= mesh.material_coordinates.size()) return {500, -500, 900};
    const auto& uv = mesh.material_coordinates[i];
    return map(static_cast<double>(uv[0]), static_cast<double>(uv[1])).cast<float>();
  });
}

/// Squares of the grid of 1 cm whose middle is kept.
SheetMesh cut_out(double width_m, double height_m, const std::function<bool(double u_m, double v_m)>& kept) {
  const auto columns = static_cast<std::uint32_t>(std::lround(width_m * 100));
  const auto rows = static_cast<std::uint32_t>(std::lround(height_m * 100));
  SheetMesh out;
  std::vector<std::uint32_t> number((columns + 1) * (rows + 1), sheet::kNone);
  const auto corner = [&](std::uint32_t c, std::uint32_t r) {
    std::uint32_t& at = number[r * (columns + 1) + c];
    if (at == sheet::kNone) {
      at = static_cast<std::uint32_t>(out.material_coordinates.size());
      out.material_coordinates.push_back({static_cast<float>(0.01 * c), static_cast<float>(0.01 * r)});
    }
    return at;
  };
  for (std::uint32_t r = 0; r < rows; ++r) {
    for (std::uint32_t c = 0; c < columns; ++c) {
      if (!kept(0.01 * (c + 0.5), 0.01 * (r + 0.5))) continue;
      const std::uint32_t a = corner(c, r), b = corner(c + 1, r), d = corner(c + 1, r + 1), e = corner(c, r + 1);
      out.triangles.push_back({a, b, d});
      out.triangles.push_back({a, d, e});
    }
  }
  return out;
}

std::vector<Resonator> regions_of(const SheetMesh& mesh, const test::Map& map, bool with_material = true) {
  auto regions = analysis::picture_regions(test::frame_of(mesh, test::topology_of(mesh, with_material), map), {}).regions;
  std::stable_sort(regions.begin(), regions.end(), [](const auto& a, const auto& b) { return a.area_m2 > b.area_m2; });
  return regions;
}

}  // namespace

TEST_CASE("degenerate, doubled and reversed triangles and unused vertices are tolerated and counted", "[flaws]") {
  const SheetMesh mesh = sheets::make_rectangle(MeshKind::kDelaunay, 0.297, 0.210, 446);
  for (const bool material : {true, false}) {
    CAPTURE(material);
    const auto degenerate = topology_of(mesh, {{1, 1, 2}, {3, 3, 3}, {4, 5, 4}}, 0, material);
    CHECK(degenerate->flaws().degenerate_triangles == 3);
    CHECK(exercise(mesh, degenerate).events > 0);

    const auto unused = topology_of(mesh, {}, 5, material);
    CHECK(unused->flaws().unused_vertices == 5);
    CHECK(exercise(mesh, unused).events > 0);

    const auto doubled = topology_of(mesh, {mesh.triangles[10], mesh.triangles[200]}, 0, material);
    CHECK(doubled->flaws().non_manifold_edges >= 4);
    CHECK(exercise(mesh, doubled).events > 0);

    SheetMesh reversed = mesh;
    for (std::size_t k = 0; k < reversed.triangles.size(); k += 9)
      std::swap(reversed.triangles[k][0], reversed.triangles[k][1]);
    const auto topology = topology_of(reversed, {}, 0, material);
    CHECK(topology->flaws().inconsistent_edges > 50);
    exercise(reversed, topology);
  }
}

TEST_CASE("triangles without area among good ones leave all results finite", "[flaws]") {
  SheetMesh mesh = sheets::make_rectangle(MeshKind::kDelaunay, 0.297, 0.210, 446);
  const auto n = static_cast<std::uint32_t>(mesh.material_coordinates.size());
  for (std::uint32_t k = 0; k < 6; ++k) {  // a vertex on the side of a triangle, or on a corner: slivers of no width
    const auto t = mesh.triangles[20 * k];
    const auto &a = mesh.material_coordinates[t[0]], &b = mesh.material_coordinates[t[1]];
    const float share = k % 2 == 0 ? 0.5f : 0.0f;
    mesh.material_coordinates.push_back({a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])});
    mesh.triangles.push_back({t[0], t[1], n + k});
  }
  for (const bool material : {true, false}) {
    const auto topology = topology_of(mesh, {}, 0, material);
    CHECK(topology->flaws().non_manifold_edges >= 6);
    CHECK(exercise(mesh, topology).events > 0);
  }
}

TEST_CASE("fins, a Moebius strip and edges of many triangles are tolerated and counted", "[flaws]") {
  SheetMesh mesh = sheets::make_rectangle(MeshKind::kStructured, 0.297, 0.210, 446);
  const auto n = static_cast<std::uint32_t>(mesh.material_coordinates.size());
  for (std::uint32_t k = 0; k < 12; ++k) {
    const auto t = mesh.triangles[10 + 16 * k];
    mesh.material_coordinates.push_back({0.02f * static_cast<float>(k), 0.3f});
    mesh.triangles.push_back({t[0], t[2], n + k});  // on the diagonal of its cell
  }
  for (const bool material : {true, false}) {
    const auto topology = topology_of(mesh, {}, 0, material);
    CHECK(topology->flaws().non_manifold_edges == 12);
    exercise(mesh, topology);
  }

  sheet::Topology::Input band;
  constexpr std::uint32_t kAround = 40;
  band.vertex_count = 2 * kAround;
  for (std::uint32_t k = 0; k < kAround; ++k) {
    const bool last = k + 1 == kAround;
    const std::uint32_t a = 2 * k, b = 2 * k + 1, c = last ? 1 : 2 * k + 2, d = last ? 0 : 2 * k + 3;
    band.triangles.push_back({a, c, b});
    band.triangles.push_back({b, c, d});
  }
  const auto moebius = sheet::Topology::make(std::move(band)).value();
  CHECK(moebius->flaws().inconsistent_edges == 1);
  int frame = 0;
  exercise(moebius, [&](std::size_t i, const test::Map&) -> Vec3f {
    frame += i == 0 ? 1 : 0;
    const double turn = 2 * 3.14159265 * static_cast<double>(i / 2) / kAround, side = i % 2 == 0 ? -0.02 : 0.02;
    const double ring = 0.1 + side * std::cos(turn / 2 + 0.3 * frame);
    return Vec3d(ring * std::cos(turn), ring * std::sin(turn), 0.05 + side * std::sin(turn / 2 + 0.3 * frame)).cast<float>();
  });

  sheet::Topology::Input star;
  star.vertex_count = 30;
  for (std::uint32_t k = 2; k < 30; ++k) star.triangles.push_back({0, 1, k});
  const auto book = sheet::Topology::make(std::move(star)).value();
  CHECK(book->flaws().non_manifold_edges == 1);
  exercise(book, [](std::size_t i, const test::Map& map) -> Vec3f {
    return map(0.01 * static_cast<double>(i), i == 0 ? 0.0 : 0.01 * static_cast<double>(i * i % 20)).cast<float>();
  });
}

TEST_CASE("sheets without area and the smallest meshes pass through", "[flaws]") {
  const SheetMesh mesh = sheets::make_rectangle(MeshKind::kStructured, 0.297, 0.210, 183);
  for (const bool material : {true, false}) {
    const auto topology = topology_of(mesh, {}, 0, material);
    exercise(topology, [](std::size_t, const test::Map&) { return Vec3f(0.1f, 0.1f, 0.1f); });
    exercise(topology, [](std::size_t i, const test::Map&) { return Vec3f(0.001f * static_cast<float>(i), 0.1f, 0.1f); });
    exercise(topology, [](std::size_t i, const test::Map& map) -> Vec3f {
      return i % 2 == 0 ? Vec3f(map(0.1, 0.1).cast<float>()) : Vec3f(0, 0, 0);
    });
  }
  SheetMesh flat_material = mesh;  // material coordinates without area
  for (auto& uv : flat_material.material_coordinates) uv = {0.1f, 0.1f};
  const auto squeezed = topology_of(flat_material);
  exercise(squeezed, [&](std::size_t i, const test::Map& map) -> Vec3f {
    const auto& uv = mesh.material_coordinates[i];
    return map(static_cast<double>(uv[0]), static_cast<double>(uv[1])).cast<float>();
  });
  for (const std::size_t vertices : {0, 1, 2, 3, 4, 6}) {
    sheet::Topology::Input input;
    input.vertex_count = vertices;
    for (std::uint32_t k = 0; k + 2 < vertices; k += 3) input.triangles.push_back({k, k + 1, k + 2});
    const auto topology = sheet::Topology::make(std::move(input)).value();
    CHECK(topology->flaws().unused_vertices == vertices % 3);
    const Heard heard = exercise(topology, [](std::size_t i, const test::Map& map) -> Vec3f {
      return map(0.05 * static_cast<double>(i), 0.04 * static_cast<double>(i * i % 3)).cast<float>();
    });
    CHECK(heard.events == 0);
  }
}

TEST_CASE("unused vertices far away change nothing", "[flaws]") {
  const auto& shape = *sheets::find_shape("strip30_oblique");
  const SheetMesh mesh = sheets::make_rectangle(MeshKind::kDelaunay, shape.width_m, shape.height_m, 1333);
  for (const bool material : {true, false}) {
    auto frame = test::frame_of(mesh, topology_of(mesh, {}, 3, material), test::map_of(*shape.shape));
    for (int k = 0; k < 3; ++k) frame.positions_m.emplace_back(5000.0f, -3000.0f, 1000.0f);
    const auto regions = analysis::picture_regions(frame, {}).regions;
    CAPTURE(material);
    REQUIRE(regions.size() == 1);
    CHECK(regions[0].ruling_length_m == Approx(sheets::known_regions(shape)[0].ruling_length_m).epsilon(0.05));
    CHECK(regions[0].free_border_length_m == Approx(0.594).epsilon(0.05));
  }
}

TEST_CASE("pieces that are not joined are regions and events of their own", "[flaws]") {
  const SheetMesh mesh = cut_out(0.4, 0.2, [](double u, double) { return u < 0.2 || u > 0.25; });
  for (const bool material : {true, false}) {
    CAPTURE(material);
    const auto regions = regions_of(mesh, test::arc(6, 0.4), material);
    REQUIRE(regions.size() == 2);
    CHECK(regions[0].area_m2 == Approx(0.04).epsilon(0.01));
    CHECK(regions[1].area_m2 == Approx(0.03).epsilon(0.01));
    for (const auto& region : regions) CHECK(region.ruling_length_m == Approx(0.2).epsilon(0.05));
    CHECK(regions[0].free_border_length_m == Approx(0.4).epsilon(0.05));
    CHECK(exercise(mesh, topology_of(mesh, {}, 0, material)).events >= 4);
  }
}

TEST_CASE("an outline that is not convex, a hole and a crack are part of the answers", "[flaws]") {
  const SheetMesh bracket = cut_out(0.3, 0.2, [](double u, double v) { return u < 0.15 || v < 0.1; });
  const SheetMesh frame = cut_out(0.3, 0.2, [](double u, double v) { return u < 0.1 || u > 0.2 || v < 0.07 || v > 0.13; });
  SheetMesh torn = cut_out(0.3, 0.2, [](double, double) { return true; });
  const auto n = static_cast<std::uint32_t>(torn.material_coordinates.size());
  std::vector<std::uint32_t> twin(n, sheet::kNone);
  for (auto& t : torn.triangles) {  // torn along u = 0.15 up to v = 0.14
    float u = 0;
    for (const auto v : t) u += torn.material_coordinates[v][0] / 3;
    for (auto& v : t) {
      const auto at = torn.material_coordinates[v];
      if (u < 0.15f || std::abs(at[0] - 0.15f) > 1e-5f || at[1] > 0.135f) continue;
      if (twin[v] == sheet::kNone) {
        twin[v] = static_cast<std::uint32_t>(torn.material_coordinates.size());
        torn.material_coordinates.push_back(at);
      }
      v = twin[v];
    }
  }
  struct Answer {
    const char* name;
    const SheetMesh& mesh;
    double area_m2, ruling_m, border_m;
  };
  for (const auto& [name, mesh, area_m2, ruling_m, border_m] :
       {Answer{"bracket", bracket, 0.045, 0.0075 / 0.045, 0.6}, Answer{"frame", frame, 0.054, 0.00898 / 0.054, 0.8},
        Answer{"torn", torn, 0.06, 0.2, 0.6}}) {
    for (const bool material : {true, false}) {
      CAPTURE(name, material);
      const auto regions = regions_of(mesh, test::arc(6, 0.3), material);
      CHECK(regions.size() == 1);
      CHECK(regions[0].area_m2 == Approx(area_m2).epsilon(0.01));
      CHECK(regions[0].ruling_length_m == Approx(ruling_m).epsilon(0.05));
      CHECK(regions[0].free_border_length_m == Approx(border_m).epsilon(0.05));
      CHECK(exercise(mesh, topology_of(mesh, {}, 0, material)).events > 0);
    }
  }
}

TEST_CASE("a curved sheet known only by its positions is unfolded: the answers of the same sheet with material ones",
          "[flaws]") {
  const auto far_turned = [](const sheets::Shape& shape) {
    return test::moved(test::map_of(shape), Eigen::Quaterniond(Eigen::AngleAxisd(1.2, Vec3d(1, 2, 3).normalized())),
                       {3, -2, 1});
  };
  for (const char* name : {"strip10", "strip30", "strip30_oblique", "strip10_5cm", "cone", "sbend"}) {
    const auto& shape = *sheets::find_shape(name);
    const auto answers = sheets::known_regions(shape);
    for (const MeshKind kind : {MeshKind::kStructured, MeshKind::kDelaunay}) {
      for (const std::size_t triangles : {446, 1333, 20000}) {
        const SheetMesh mesh = sheets::make_rectangle(kind, shape.width_m, shape.height_m, triangles);
        const auto regions = regions_of(mesh, far_turned(*shape.shape), false);
        CAPTURE(name, static_cast<int>(kind), triangles);
        CHECK(regions.size() == answers.size());
        if (regions.size() != answers.size()) continue;
        for (std::size_t k = 0; k < answers.size(); ++k) {
          CHECK_FALSE(regions[k].constrained);
          CHECK(regions[k].ruling_length_m == Approx(answers[k].ruling_length_m).epsilon(0.05));
          CHECK(regions[k].free_border_length_m == Approx(answers[k].free_border_length_m).epsilon(0.05));
        }
      }
    }
  }
}

}  // namespace mesh_flaws_test
