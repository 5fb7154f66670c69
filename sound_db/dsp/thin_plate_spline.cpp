#include "sound_db/dsp/thin_plate_spline.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <cstdint>
#include <map>

#include <Eigen/Dense>

namespace rustle::dsp {

namespace {

using Matrix = Eigen::MatrixXd;

constexpr double kCoincidence = 1e-9;  ///< of nodes, in units of their spread
constexpr double kRankTolerance = 1e-10;

double kernel(double squared_distance) noexcept {
  return squared_distance > 0 ? squared_distance * std::log(squared_distance) : 0.0;
}

/// Distinct nodes, the mean displacement at each and how many fell together there.
struct MergedNodes {
  Matrix at, displacement;  ///< [count][dims]
  Eigen::VectorXd multiplicity;
};

MergedNodes merged(const Matrix& nodes, const Matrix& displacements) {
  std::map<std::vector<std::int64_t>, Eigen::Index> places;
  std::vector<Eigen::Index> first, place_of;
  for (Eigen::Index i = 0; i < nodes.rows(); ++i) {
    std::vector<std::int64_t> key;
    for (Eigen::Index d = 0; d < nodes.cols(); ++d) key.push_back(std::llround(nodes(i, d) / kCoincidence));
    const auto [known, added] = places.emplace(std::move(key), static_cast<Eigen::Index>(first.size()));
    if (added) first.push_back(i);
    place_of.push_back(known->second);
  }
  const auto count = static_cast<Eigen::Index>(first.size());
  MergedNodes result{Matrix(count, nodes.cols()), Matrix::Zero(count, nodes.cols()), Eigen::VectorXd::Zero(count)};
  for (Eigen::Index k = 0; k < count; ++k) result.at.row(k) = nodes.row(first[static_cast<std::size_t>(k)]);
  for (Eigen::Index i = 0; i < nodes.rows(); ++i) {
    const Eigen::Index place = place_of[static_cast<std::size_t>(i)];
    result.displacement.row(place) += displacements.row(i);
    result.multiplicity(place) += 1;
  }
  for (Eigen::Index k = 0; k < count; ++k) result.displacement.row(k) /= result.multiplicity(k);
  return result;
}

template <class Number>
void evaluate(const ThinPlateSpline& spline, std::span<const Number> f, std::span<Number> out) noexcept {
  const auto dims = static_cast<std::size_t>(spline.dims);
  assert(f.size() == dims && out.size() == dims && spline.dims <= kMostWarpDims);
  if (spline.identity()) {
    std::copy(f.begin(), f.end(), out.begin());
    return;
  }
  std::array<double, kMostWarpDims> y{}, shift{};
  for (std::size_t d = 0; d < dims; ++d) {
    y[d] = (static_cast<double>(f[d]) - spline.centre[d]) / spline.scale;
    shift[d] = spline.affine[d];
  }
  for (std::size_t k = 0; k < dims; ++k) {
    for (std::size_t d = 0; d < dims; ++d) shift[d] += spline.affine[(k + 1) * dims + d] * y[k];
  }
  for (std::size_t k = 0; k < spline.node_count(); ++k) {
    double squared = 0;
    for (std::size_t d = 0; d < dims; ++d) {
      const double apart = y[d] - spline.nodes[k * dims + d];
      squared += apart * apart;
    }
    const double u = kernel(squared);
    for (std::size_t d = 0; d < dims; ++d) shift[d] += spline.weights[k * dims + d] * u;
  }
  for (std::size_t d = 0; d < dims; ++d) {
    out[d] = static_cast<Number>(static_cast<double>(f[d]) + spline.scale * shift[d]);
  }
}

std::vector<double> row_major(const Matrix& matrix) {
  std::vector<double> values;
  for (Eigen::Index r = 0; r < matrix.rows(); ++r) {
    for (Eigen::Index c = 0; c < matrix.cols(); ++c) values.push_back(matrix(r, c));
  }
  return values;
}

}  // namespace

ThinPlateSpline identity_warp(int dims) {
  ThinPlateSpline spline;
  spline.dims = dims;
  spline.centre.assign(static_cast<std::size_t>(dims), 0.0);
  return spline;
}

void warp(const ThinPlateSpline& spline, std::span<const float> f, std::span<float> out) noexcept {
  evaluate(spline, f, out);
}

void warp(const ThinPlateSpline& spline, std::span<const double> f, std::span<double> out) noexcept {
  evaluate(spline, f, out);
}

ThinPlateSpline fit_thin_plate_spline(std::span<const double> nodes, std::span<const double> targets, int dims,
                                      double lambda) {
  assert(dims >= 1 && dims <= kMostWarpDims && !nodes.empty() && nodes.size() == targets.size());
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const auto count = static_cast<Eigen::Index>(nodes.size()) / dims;
  const Matrix f = Eigen::Map<const RowMajor>(nodes.data(), count, dims);
  const Matrix g = Eigen::Map<const RowMajor>(targets.data(), count, dims);
  const Eigen::RowVectorXd centre = f.colwise().mean();
  const Matrix centred = f.rowwise() - centre;
  const double scale = std::max(std::sqrt(centred.rowwise().squaredNorm().mean()), 1e-12);
  const MergedNodes merge = merged(centred / scale, (g - f) / scale);
  const Matrix &x = merge.at, &v = merge.displacement;
  const Eigen::Index n = x.rows();

  // The logarithm of the scale cancels against the affine part, so that λ scales as a squared length.
  Matrix k(n, n), p(n, dims + 1);
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j < n; ++j) k(i, j) = kernel((x.row(i) - x.row(j)).squaredNorm());
    k(i, i) += lambda / (scale * scale) / merge.multiplicity(i);
  }
  p << Eigen::VectorXd::Ones(n), x;

  const Eigen::JacobiSVD<Matrix> svd(p, Eigen::ComputeFullU | Eigen::ComputeThinV);
  const Eigen::VectorXd s = svd.singularValues();
  Eigen::Index rank = 0;
  while (rank < s.size() && s(rank) > kRankTolerance * s(0)) ++rank;
  const Matrix range = svd.matrixU().leftCols(rank), null = svd.matrixU().rightCols(n - rank);
  Matrix w = Matrix::Zero(n, dims);
  if (null.cols() > 0) {
    const Matrix inner = null.transpose() * k * null, right = null.transpose() * v;
    const Eigen::LLT<Matrix> cholesky(inner);
    w = null * (cholesky.info() == Eigen::Success ? Matrix(cholesky.solve(right))
                                                  : Matrix(inner.completeOrthogonalDecomposition().solve(right)));
  }
  const Matrix rest = range.transpose() * (v - k * w);
  const Matrix affine = svd.matrixV().leftCols(rank) * s.head(rank).cwiseInverse().asDiagonal() * rest;

  ThinPlateSpline spline;
  spline.dims = dims;
  spline.centre.assign(centre.data(), centre.data() + dims);
  spline.scale = scale;
  spline.affine = row_major(affine);
  spline.nodes = row_major(x);
  spline.weights = row_major(w);
  return spline;
}

}  // namespace rustle::dsp
