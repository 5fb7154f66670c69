#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <set>

#include "client_sdk/sheets/demos.h"
#include "server/page/partition.h"
#include "tests/support/animated_frames.h"

namespace page_partition_test {
namespace {

using namespace rustle;
using namespace rustle::page;

constexpr int kAcross = 40, kAlong = 20;  // cells of 5 mm

/// A sheet of 20 by 10 cm.
std::shared_ptr<const sheet::Topology> sheet_of_paper() {
  sheet::Topology::Input input;
  input.vertex_count = (kAcross + 1) * (kAlong + 1);
  for (std::uint32_t y = 0; y <= kAlong; ++y)
    for (std::uint32_t x = 0; x <= kAcross; ++x)
      input.material_coordinates_m.emplace_back(0.005F * static_cast<float>(x), 0.005F * static_cast<float>(y));
  for (std::uint32_t y = 0; y < kAlong; ++y) {
    for (std::uint32_t x = 0; x < kAcross; ++x) {
      const std::uint32_t a = y * (kAcross + 1) + x, b = a + 1, d = a + kAcross + 1, c = d + 1;
      input.triangles.push_back({a, b, c});
      input.triangles.push_back({a, c, d});
    }
  }
  return sheet::Topology::make(std::move(input)).value();
}

template <class Shape>
sheet::MeshFrame frame_of(const std::shared_ptr<const sheet::Topology>& topology, double time_s, const Shape& shape) {
  sheet::MeshFrame frame;
  frame.time_s = time_s;
  frame.topology = topology;
  for (const auto& m : topology->material_coordinates_m()) frame.positions_m.push_back(shape(m.x(), m.y()));
  return frame;
}

}  // namespace

TEST_CASE("a folded sheet has a region on each side, and a ridge between", "[page]") {
  const auto topology = sheet_of_paper();
  Partition partition;
  const auto frame = frame_of(topology, 0, [](float x, float y) {
    const float s = x - 0.1F;
    return sheet::Vec3f(0.8F * s, y, 0.6F * std::abs(s));
  });
  partition.update(frame);
  REQUIRE(partition.regions().size() == topology->vertex_count());
  CHECK(std::set<std::uint16_t>(partition.regions().begin(), partition.regions().end()).size() == 2);
  CHECK(partition.regions().front() != partition.regions()[kAcross]);
  const auto ridges = partition.ridges(frame.positions_m);
  REQUIRE(ridges.size() >= kAlong);
  for (const auto& [start, end] : ridges) CHECK(std::max(std::abs(start.x()), std::abs(end.x())) < 0.0045F);
  CHECK(partition.rulings(frame.positions_m).empty());
}

TEST_CASE("rulings run straight across a bent sheet, wherever it is", "[page]") {
  const auto topology = sheet_of_paper();
  Partition partition;
  const auto bent = [](const sheet::Vec3f& at) {
    return [at](float x, float y) {
      constexpr float kCurvature = 8;
      return sheet::Vec3f(
          at + sheet::Vec3f(std::sin(kCurvature * x) / kCurvature, y, (1 - std::cos(kCurvature * x)) / kCurvature));
    };
  };
  const auto frame = frame_of(topology, 0, bent({0, 0, 0})), moved = frame_of(topology, 0.1, bent({3, -2, 1}));
  partition.update(frame);
  const auto rulings = partition.rulings(frame.positions_m), of_moved = partition.rulings(moved.positions_m);
  REQUIRE(rulings.size() > 50);
  for (std::size_t k = 0; k < rulings.size(); ++k) {
    const sheet::Vec3f along = rulings[k][1] - rulings[k][0];
    CHECK(along.norm() > 0.002F);
    CHECK(std::abs(along.y()) > 0.97F * along.norm());
    CHECK((of_moved[k][0] - rulings[k][0] - sheet::Vec3f(3, -2, 1)).norm() < 1e-5F);
  }
}

TEST_CASE("a region keeps its number while others come and go", "[page]") {
  const auto topology = sheet_of_paper();
  Partition partition;
  // Flat, then folded at the middle: what stays the larger part keeps its number.
  const auto folded_at = [&](float where, double time_s) {
    return frame_of(topology, time_s, [where](float x, float y) {
      const float s = x - where;
      return s < 0 ? sheet::Vec3f(x, y, 0) : sheet::Vec3f(where + 0.5F * s, y, 0.866F * s);
    });
  };
  partition.update(folded_at(0.15F, 0));
  const auto of_large = partition.regions().front();
  const auto of_small = partition.regions()[kAcross];
  REQUIRE(of_large != of_small);
  for (int k = 1; k <= 10; ++k) {
    partition.update(folded_at(0.15F - 0.01F * static_cast<float>(k), k / 30.0));
    CHECK(partition.regions().front() == of_large);
    CHECK(partition.regions()[kAcross] == of_small);
  }
}

TEST_CASE("a fine sheet's vertices have the regions of its coarse stand-in, and a moving one stays within its mesh",
          "[page]") {
  const auto fine = sheets::make_demo("shake", 6000);
  const test_support::AnimatedFrames frames(*fine);
  Partition partition;
  for (int k = 0; k < 10; ++k) {
    const auto frame = frames.at(k / 30.0);
    partition.update(frame);
    REQUIRE(partition.regions().size() == frame.positions_m.size());
    CHECK(std::count(partition.regions().begin(), partition.regions().end(), kNoRegion) == 0);
    sheet::Vec3f low = frame.positions_m.front(), high = low;
    for (const auto& p : frame.positions_m) low = low.cwiseMin(p), high = high.cwiseMax(p);
    for (const auto& [start, end] : partition.ridges(frame.positions_m)) {
      CHECK((start.array() >= low.array()).all());
      CHECK((end.array() <= high.array()).all());
    }
  }
}

TEST_CASE("a sheet without triangles has no regions", "[page]") {
  sheet::Topology::Input input;
  input.vertex_count = 3;
  sheet::MeshFrame frame;
  frame.topology = sheet::Topology::make(std::move(input)).value();
  frame.positions_m.assign(3, sheet::Vec3f::Zero());
  Partition partition;
  partition.update(frame);
  CHECK(std::count(partition.regions().begin(), partition.regions().end(), kNoRegion) == 3);
  CHECK(partition.ridges(frame.positions_m).empty());
}

}  // namespace page_partition_test
