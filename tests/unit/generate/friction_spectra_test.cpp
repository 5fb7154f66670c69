#include <catch2/catch.hpp>
#include <map>

#include "sound_db/dsp/level.h"
#include "sound_db/generate/friction_spectrum.h"
#include "sound_db/pack/bent_strip.h"
#include "sound_db/pack/emission.h"
#include "tests/unit/generate/measures.h"

namespace friction_spectra_test {

using namespace rustle;
using namespace rustle::generate;
using pack::GridPoint;

namespace {

using Histogram = std::vector<double>;

/// Where the parts of a bent sheet are above its table.
struct Heights {
  double mean_m, spread_m;
};

Heights of_strip(double edge_m, double compression) {
  const auto strip = pack::bent_strip(edge_m, compression);
  return {strip.mean_height_m, strip.height_spread_m};
}

/// Curved borders of 4 and 16 cm: strips of every length between them, by their length.
Heights of_slanted_trapezoid() {
  double length = 0, height = 0, square = 0;
  for (int i = 0; i <= 40; ++i) {
    const double edge_m = 0.04 + 0.003 * i;
    const Heights strip = of_strip(edge_m, 0.30);
    length += edge_m;
    height += edge_m * strip.mean_m;
    square += edge_m * (strip.spread_m * strip.spread_m + strip.mean_m * strip.mean_m);
  }
  return {height / length, std::sqrt(square / length - height * height / length / length)};
}

/// Straight borders of 4 and 16 cm 10 cm apart: rulings that grow along the arc.
Heights of_widening_trapezoid() {
  const auto strip = pack::bent_strip(0.10, 0.30);
  double width = 0, height = 0, square = 0;
  for (int i = 0; i <= 400; ++i) {
    const double angle = strip.half_angle_rad * (i - 200) / 200, w = 0.04 + 0.12 * i / 400;
    const double h = strip.radius_m * (std::cos(angle) - std::cos(strip.half_angle_rad));
    width += w, height += w * h, square += w * h * h;
  }
  return {height / width, std::sqrt(square / width - height * height / width / width)};
}

/// Magnitudes of a resonator's friction 1 m away, 30° above its table, from the pack's nearest spectrum.
std::vector<float> played(const GridPoint& wanted, const Heights& heights) {
  const pack::FrictionSection& section = *packs().front().friction;
  const auto emission = pack::emission_spectrum(section, *pack::nearest_spectrum(section, wanted), 513, kRate_hz);
  if (wanted.constrained()) return emission;
  std::vector<float> heard;
  for (std::size_t k = 0; k < emission.size(); ++k) {
    const double h =
        pack::transfer_magnitude({heights.mean_m, heights.spread_m, 1.0, 30.0}, 46.875 * static_cast<double>(k));
    heard.push_back(static_cast<float>(emission[k] * h));
  }
  return heard;
}

std::vector<float> sheet(double ruling_m, double edge_m, double compression = 0.30) {
  return played({ruling_m, 2 * edge_m}, of_strip(edge_m, compression));
}

double distance(const std::vector<float>& a, const std::vector<float>& b) {
  return dsp::quadratic_form_distance(dsp::spectrum_histogram(a), dsp::spectrum_histogram(b));
}

std::array<double, 3> distances(const std::vector<float>& a, const std::vector<float>& b, const std::vector<float>& c) {
  return {distance(a, b), distance(b, c), distance(a, c)};
}

double centroid_of(const std::vector<float>& magnitudes) {
  return dsp::spectral_centroid_hz(magnitudes, kRate_hz);
}

/// The resonance bands in dB: a spectrum over the same without bands, 150 Hz to 2.5 kHz, mean removed.
std::vector<double> bands_db(const Paper& paper, const GridPoint& point) {
  const auto heard = friction_heard(paper, point, 1025, kRate_hz);
  std::vector<double> level_db;
  double sum = 0;
  for (std::size_t k = 7; k < 107; ++k) {
    const double f = 23.4375 * static_cast<double>(k), high = f / friction_corner_hz(paper, point), low = 250 / f;
    level_db.push_back(20 * std::log10(heard[k] * std::sqrt(1 + low * low) * (1 + high * high)));
    sum += level_db.back() / 100;
  }
  for (double& l : level_db) l -= sum;
  return level_db;
}

double correlation(const std::vector<double>& a, const std::vector<double>& b) {
  double ab = 0, aa = 0, bb = 0;
  for (std::size_t k = 0; k < a.size(); ++k) ab += a[k] * b[k], aa += a[k] * a[k], bb += b[k] * b[k];
  return ab / std::sqrt(aa * bb);
}

}  // namespace

TEST_CASE(
    "Table 1: by l_r and l_c within 0.05 of the paper's, by compression and shape in (0, 0.09], a third of them at most") {
  const auto by_ruling = distances(sheet(0.05, 0.1), sheet(0.1, 0.1), sheet(0.2, 0.1));
  const auto by_border = distances(sheet(0.1, 0.05), sheet(0.1, 0.1), sheet(0.1, 0.2));
  const auto by_compression = distances(sheet(0.1, 0.1, 0.2), sheet(0.1, 0.1, 0.4), sheet(0.1, 0.1, 0.8));
  // Where the slanted rulings go on, they are 10.5 cm long; the widening trapezoid's borders are 11.66 cm long.
  const auto by_shape = distances(sheet(0.1, 0.1), played({0.105, 0.20}, of_slanted_trapezoid()),
                                  played({0.10, 2 * 0.1166}, of_widening_trapezoid()));
  const std::array<double, 3> paper_by_ruling{0.10, 0.07, 0.16}, paper_by_border{0.04, 0.12, 0.13};
  double sizes = 0, compressions = 0, shapes = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    INFO(i << ": l_r " << by_ruling[i] << ", l_c " << by_border[i] << ", compression " << by_compression[i] << ", shape "
           << by_shape[i]);
    CHECK(by_ruling[i] == Approx(paper_by_ruling[i]).margin(0.05));
    CHECK(by_border[i] == Approx(paper_by_border[i]).margin(0.05));
    CHECK((by_compression[i] > 0 && by_compression[i] <= 0.09));
    CHECK((by_shape[i] > 0 && by_shape[i] <= 0.09));
    sizes += (by_ruling[i] + by_border[i]) / 6;
    compressions += by_compression[i] / 3;
    shapes += by_shape[i] / 3;
  }
  INFO("means: size " << sizes << ", compression " << compressions << ", shape " << shapes);
  CHECK((compressions >= 0.015 && compressions <= 0.05));
  CHECK((shapes >= 0.015 && shapes <= 0.05));
  CHECK(sizes / ((compressions + shapes) / 2) >= 3);
}

TEST_CASE("Fig. 12: A4 below half A4 and A5, these below A6, each by 3 % in centroid; a flat A4 apart by 0.05") {
  const auto a4 = sheet(0.297, 0.210), half = sheet(0.148, 0.210), a5 = sheet(0.297, 0.105), a6 = sheet(0.148, 0.105);
  INFO("A4 " << centroid_of(a4) << ", half A4 " << centroid_of(half) << ", A5 " << centroid_of(a5) << ", A6 "
             << centroid_of(a6));
  for (const auto* between : {&half, &a5}) {
    CHECK(centroid_of(*between) >= 1.03 * centroid_of(a4));
    CHECK(centroid_of(a6) >= 1.03 * centroid_of(*between));
  }
  CHECK(distance(a4, played({}, {})) >= 0.05);
}

TEST_CASE("neighbouring sizes: centroid falls with l_r and l_c, the step above the estimator's noise") {
  const auto grid = full_grid();
  for (const Paper& paper : papers()) {
    std::vector<std::vector<float>> heard;
    for (const GridPoint& point : grid) heard.push_back(friction_heard(paper, point, 513, kRate_hz));
    for (std::size_t i = 0; i < 81; ++i) {
      for (const std::size_t next : {i + 1, i + 9}) {
        if (next >= 81 || (next == i + 1 && i % 9 == 8)) continue;
        INFO(paper.name << " l_r " << grid[i].ruling_length_m << " l_c " << grid[i].free_border_length_m);
        CHECK(centroid_of(heard[next]) < 0.995 * centroid_of(heard[i]));
        CHECK(distance(heard[next], heard[i]) > 0.005);
      }
    }
  }
  // The noise: ten seconds of the same sliding, twice.
  const pack::FrictionSection& section = *packs().front().friction;
  for (const GridPoint& point : {GridPoint{0.1, 0.2}, GridPoint{0.3, 0.6}}) {
    const auto heard = friction_heard(printer(), point, 513, kRate_hz);
    for (std::uint64_t i = 0; i < 2; ++i) {
      CHECK(dsp::spectrum_distance(friction_noise(heard, 10, section, dsp::Random(2 * i)),
                                   friction_noise(heard, 10, section, dsp::Random(2 * i + 1))) < 0.004);
    }
  }
}

TEST_CASE("friction of the three materials differs by twice the estimator's noise at every size, flat or bent") {
  auto points = full_grid();
  points.push_back({});
  for (const GridPoint& point : points) {
    std::vector<std::vector<float>> heard;
    for (const Paper& paper : papers()) heard.push_back(friction_heard(paper, point, 513, kRate_hz));
    INFO("l_r " << point.ruling_length_m << " l_c " << point.free_border_length_m);
    CHECK(distance(heard[0], heard[1]) > 0.018);
    CHECK(distance(heard[0], heard[2]) > 0.018);
    CHECK(distance(heard[1], heard[2]) > 0.036);
    CHECK(centroid_of(heard[1]) > 1.003 * centroid_of(heard[0]));
    CHECK(centroid_of(heard[2]) < 0.997 * centroid_of(heard[0]));
  }
}

TEST_CASE("bands of about 3 dB stand where the bent sheet's modes are, elsewhere for another size or material") {
  const GridPoint here{0.1, 0.2};
  const auto bands = bands_db(printer(), here);
  double square = 0;
  for (const double b : bands) square += b * b / static_cast<double>(bands.size());
  CHECK(std::sqrt(square) == Approx(3).margin(1));
  CHECK(correlation(bands, bands_db(printer(), {0.1, 0.25})) < 0.6);
  CHECK(correlation(bands, bands_db(printer(), {0.125, 0.2})) < 0.6);
  for (const Paper& paper : papers().subspan(1)) CHECK(correlation(bands, bands_db(paper, here)) < 0.6);
  // More bending, stiffer across the rulings: the modes that bend them rise.
  const auto flatter = strip_modes_hz(printer(), 0.1, 0.1, 0.1, 6000),
             rounder = strip_modes_hz(printer(), 0.1, 0.1, 0.3, 6000);
  CHECK(rounder.size() < flatter.size());
}

TEST_CASE("a flat sheet is 11 dB below a bent one, near white") {
  const auto flat = friction_heard(printer(), {}, 513, 48000), bent = friction_heard(printer(), {0.1, 0.2}, 513, 48000);
  const auto level_db = [](const std::vector<float>& m) {
    double power = 0;
    int count = 0;
    for (std::size_t k = 3; k < 341; ++k, ++count) power += m[k] * m[k];
    return 10 * std::log10(power / count);
  };
  CHECK(level_db(bent) - level_db(flat) == Approx(11).margin(0.2));
  CHECK(dsp::gain_to_db(flat[300] / flat[40]) > -4);
  CHECK(dsp::quadratic_form_distance(dsp::spectrum_histogram(flat), dsp::spectrum_histogram(bent)) > 0.05);
}

}  // namespace friction_spectra_test
