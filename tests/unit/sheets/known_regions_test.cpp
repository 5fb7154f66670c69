#include "client_sdk/sheets/known_regions.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numeric>

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

namespace known_regions_test {

using namespace rustle::sheets;

TEST_CASE("The answers of sheets bent along a side are those of the formulas") {
  const auto of = [](const char* name) { return known_regions(*find_shape(name)); };
  const double area = 0.297 * 0.210;
  REQUIRE(of("flat").size() == 1);
  CHECK(of("flat")[0].constrained);
  CHECK(of("flat")[0].area_m2 == Approx(area));
  const auto strip = of("strip10");
  REQUIRE(strip.size() == 1);
  CHECK_FALSE(strip[0].constrained);
  CHECK(strip[0].ruling_length_m == Approx(0.210));
  CHECK(strip[0].free_border_length_m == Approx(2 * 0.297));
  const auto half = of("half_bent");  // bent from 0.02 right of the centre on
  REQUIRE(half.size() == 2);
  CHECK(half[0].constrained);
  CHECK(half[1].area_m2 == Approx(0.1285 * 0.210).epsilon(0.01));
  CHECK(half[1].free_border_length_m == Approx(2 * 0.1285).epsilon(1e-3));
  const auto folded = of("folded");
  REQUIRE(folded.size() == 2);
  for (const auto& region : folded) {
    CHECK(region.area_m2 == Approx(area / 2));
    CHECK(region.ruling_length_m == Approx(0.210));
    CHECK(region.free_border_length_m == Approx(0.297).epsilon(1e-3));
  }
}

TEST_CASE("Rulings stay straight in space, and pieces cover the sheet but for their ridges") {
  for (const NamedShape& named : shape_zoo()) {
    INFO(named.name);
    const double u = 0.4 * named.width_m, v = 0.45 * named.height_m, h = 0.01;
    const auto along = named.shape->ruling(u, v);
    CHECK(std::hypot(along[0], along[1]) == Approx(1));
    const Point3 a = named.shape->at(u - h * along[0], v - h * along[1]), b = named.shape->at(u, v),
                 c = named.shape->at(u + h * along[0], v + h * along[1]);
    for (std::size_t k = 0; k < 3; ++k) CHECK(a[k] + c[k] == Approx(2 * b[k]).margin(1e-9));
    double area = 0;
    for (const auto& region : known_regions(named)) area += region.area_m2;
    const double ridge_m = named.name == "fold3mm" ? 0.003 * 0.2317 : named.name == "dogear" ? 0.00078 : 0.0;
    CHECK(area == Approx(named.width_m * named.height_m - ridge_m).epsilon(2e-3));
  }
}

TEST_CASE("The answers are those of the reference implementation") {
  const std::filesystem::path file =
      std::filesystem::path(RUSTLE_SOURCE_DIR).parent_path() / "shared/reference/expected/zoo.json";
  if (!std::filesystem::exists(file)) {
    WARN("skipped: " << file << " is not here");
    return;
  }
  const auto zoo = nlohmann::json::parse(std::ifstream(file));
  for (const auto& [name, expected] : zoo.at("shapes").items()) {
    INFO(name);
    const NamedShape* shape = find_shape(name);
    REQUIRE(shape != nullptr);
    const auto regions = known_regions(*shape, zoo.at("flat_bending_per_m"));
    REQUIRE(regions.size() == expected.size());
    for (const auto& theirs : expected) {
      const auto near = [&](const KnownRegion& r) {
        return std::hypot(r.centroid_m[0] - theirs.at("centroid")[0].get<double>(),
                          r.centroid_m[1] - theirs.at("centroid")[1].get<double>()) < 2e-3;
      };
      const auto ours = std::find_if(regions.begin(), regions.end(), near);
      REQUIRE(ours != regions.end());
      CHECK(ours->area_m2 == Approx(theirs.at("area").get<double>()).epsilon(0.01));
      CHECK(ours->ruling_length_m == Approx(theirs.at("l_r").get<double>()).epsilon(0.005));
      CHECK(ours->free_border_length_m == Approx(theirs.at("l_c").get<double>()).epsilon(0.002));
      CHECK(ours->constrained == theirs.at("constrained").get<bool>());
    }
  }
}

}  // namespace known_regions_test
