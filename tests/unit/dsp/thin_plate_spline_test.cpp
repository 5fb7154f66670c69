#include <catch2/catch.hpp>

#include <cmath>
#include <vector>

#include <Eigen/Dense>

#include "sound_db/dsp/random.h"
#include "sound_db/dsp/thin_plate_spline.h"

namespace rustle::dsp::thin_plate_spline_test {
namespace {

constexpr int kDims = 3;

struct Correspondences {
  std::vector<double> nodes, targets;
  std::size_t count() const { return nodes.size() / kDims; }
};

/// Scattered nodes and a bent, scaled and shifted image of them.
Correspondences scattered(std::size_t count, std::uint64_t seed) {
  Random random(seed);
  Correspondences c;
  for (std::size_t i = 0; i < count * kDims; ++i) {
    c.nodes.push_back(random.normal() * 2 - 10);
    c.targets.push_back(0.8 * c.nodes.back() + 3 + 0.6 * std::sin(c.nodes.back()) + 0.2 * random.normal());
  }
  return c;
}

std::vector<double> warped(const ThinPlateSpline& spline, const std::vector<double>& points) {
  std::vector<double> out(points.size());
  for (std::size_t i = 0; i < points.size(); i += kDims) {
    warp(spline, std::span(points).subspan(i, kDims), std::span(out).subspan(i, kDims));
  }
  return out;
}

double worst(const std::vector<double>& a, const std::vector<double>& b) {
  double most = 0;
  for (std::size_t i = 0; i < a.size(); ++i) most = std::max(most, std::abs(a[i] - b[i]));
  return most;
}

/// The least-squares affine image of the nodes.
std::vector<double> affine_image(const Correspondences& c) {
  const auto n = static_cast<Eigen::Index>(c.count());
  Eigen::MatrixXd p(n, kDims + 1), g(n, kDims);
  for (Eigen::Index i = 0; i < n; ++i) {
    p(i, 0) = 1;
    for (int d = 0; d < kDims; ++d) {
      p(i, d + 1) = c.nodes[static_cast<std::size_t>(i * kDims + d)];
      g(i, d) = c.targets[static_cast<std::size_t>(i * kDims + d)];
    }
  }
  const Eigen::MatrixXd image = p * p.colPivHouseholderQr().solve(g);
  std::vector<double> values;
  for (Eigen::Index i = 0; i < n; ++i) {
    for (int d = 0; d < kDims; ++d) values.push_back(image(i, d));
  }
  return values;
}

TEST_CASE("Without regularization the warp reproduces distinct correspondences") {
  const auto c = scattered(400, 1);
  CHECK(worst(warped(fit_thin_plate_spline(c.nodes, c.targets, kDims, 0), c.nodes), c.targets) < 1e-6);
}

TEST_CASE("With endless regularization the warp is the least-squares affine map") {
  const auto c = scattered(400, 2);
  const auto affine = affine_image(c);
  CHECK(worst(warped(fit_thin_plate_spline(c.nodes, c.targets, kDims, 1e12), c.nodes), affine) < 1e-6);
  CHECK(worst(warped(fit_thin_plate_spline(c.nodes, c.targets, kDims, 100), c.nodes), affine) > 1e-3);
}

TEST_CASE("More regularization fits less and bends less") {
  const auto c = scattered(200, 3);
  double fit_before = -1, bend_before = 1e300;
  for (const double lambda : {0.0, 1.0, 100.0, 1e4, 1e6}) {
    const auto spline = fit_thin_plate_spline(c.nodes, c.targets, kDims, lambda);
    const auto image = warped(spline, c.nodes);
    double error = 0, bend = 0;
    for (std::size_t i = 0; i < image.size(); ++i) error += std::pow(image[i] - c.targets[i], 2);
    for (const double w : spline.weights) bend += w * w;
    CHECK(error > fit_before);
    CHECK(bend < bend_before);
    fit_before = error;
    bend_before = bend;
  }
}

TEST_CASE("The same as the plain dense system") {
  // Belongie et al. 2002: [K + λI, P; Pᵀ, 0] in features unscaled.
  const auto c = scattered(60, 4);
  const double lambda = 100;
  const auto n = static_cast<Eigen::Index>(c.count());
  const auto node = [&](Eigen::Index i, int d) { return c.nodes[static_cast<std::size_t>(i * kDims + d)]; };
  const auto kernel = [](double r2) { return r2 > 0 ? r2 * std::log(r2) : 0.0; };
  Eigen::MatrixXd a = Eigen::MatrixXd::Zero(n + 4, n + 4), right = Eigen::MatrixXd::Zero(n + 4, kDims);
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j < n; ++j) {
      double r2 = 0;
      for (int d = 0; d < kDims; ++d) r2 += std::pow(node(i, d) - node(j, d), 2);
      a(i, j) = kernel(r2) + (i == j ? lambda : 0);
    }
    a(i, n) = a(n, i) = 1;
    for (int d = 0; d < kDims; ++d) {
      a(i, n + 1 + d) = a(n + 1 + d, i) = node(i, d);
      right(i, d) = c.targets[static_cast<std::size_t>(i * kDims + d)] - node(i, d);
    }
  }
  const Eigen::MatrixXd solution = a.fullPivLu().solve(right);
  const auto elsewhere = scattered(50, 5).nodes;
  std::vector<double> expected = elsewhere;
  for (std::size_t p = 0; p < elsewhere.size(); p += kDims) {
    for (int d = 0; d < kDims; ++d) {
      double shift = solution(n, d);
      for (int e = 0; e < kDims; ++e) shift += solution(n + 1 + e, d) * elsewhere[p + static_cast<std::size_t>(e)];
      for (Eigen::Index k = 0; k < n; ++k) {
        double r2 = 0;
        for (int e = 0; e < kDims; ++e) r2 += std::pow(elsewhere[p + static_cast<std::size_t>(e)] - node(k, e), 2);
        shift += solution(k, d) * kernel(r2);
      }
      expected[p + static_cast<std::size_t>(d)] += shift;
    }
  }
  CHECK(worst(warped(fit_thin_plate_spline(c.nodes, c.targets, kDims, lambda), elsewhere), expected) < 1e-7);
}

TEST_CASE("Coincident nodes weigh as one with their mean target") {
  auto c = scattered(120, 6);
  const auto once = c;
  for (std::size_t i = 0; i < 30 * kDims; ++i) {
    c.nodes.push_back(once.nodes[i]);
    c.targets.push_back(once.targets[i] + 0.5);
  }
  const auto spline = fit_thin_plate_spline(c.nodes, c.targets, kDims, 0);
  CHECK(spline.node_count() == once.count());
  const auto image = warped(spline, once.nodes);
  for (std::size_t i = 0; i < image.size(); ++i) {
    CHECK(image[i] == Approx(once.targets[i] + (i < 30 * kDims ? 0.25 : 0.0)).margin(1e-6));
  }
}

TEST_CASE("Few, flat or equal nodes still give a warp") {
  const std::vector<double> one = {1, 2, 3}, to = {4, 4, 4};
  CHECK(worst(warped(fit_thin_plate_spline(one, to, kDims, 100), one), to) < 1e-9);
  auto flat = scattered(40, 7);
  for (std::size_t i = 2; i < flat.nodes.size(); i += kDims) flat.nodes[i] = 1;
  flat.targets = flat.nodes;
  for (double& x : flat.targets) x += 1;
  CHECK(worst(warped(fit_thin_plate_spline(flat.nodes, flat.targets, kDims, 1), flat.nodes), flat.targets) < 1e-9);
  const auto nothing = identity_warp(kDims);
  CHECK(worst(warped(nothing, one), one) == 0);
}

}  // namespace
}  // namespace rustle::dsp::thin_plate_spline_test
