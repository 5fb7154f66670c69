#include "server/sheet/rest_plane.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "server/sheet/disjoint_sets.h"

namespace rustle::sheet {
namespace {

void label_components(const Topology& topology, RestPlane& plane) {
  DisjointSets sets(topology.vertex_count());
  for (const Triangle& v : topology.triangles()) sets.join(v[0], v[1]), sets.join(v[0], v[2]);
  plane.component.resize(topology.vertex_count());
  for (std::uint32_t i = 0; i < topology.vertex_count(); ++i) {
    const std::uint32_t root = sets.find(i);
    plane.component[i] = root == i ? plane.component_count++ : plane.component[root];
  }
}

double cross(const Vec2d& a, const Vec2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

struct Piece {
  std::vector<std::uint32_t> vertices, triangles;
};

std::vector<Piece> pieces(const Topology& topology, const RestPlane& plane) {
  std::vector<Piece> out(plane.component_count);
  for (std::uint32_t i = 0; i < topology.vertex_count(); ++i) out[plane.component[i]].vertices.push_back(i);
  for (std::uint32_t f = 0; f < topology.triangle_count(); ++f) {
    out[plane.component[topology.triangles()[f][0]]].triangles.push_back(f);
  }
  return out;
}

/// Σ (layout length - length)² and Σ length² over the sides of a piece's triangles.
std::pair<double, double> length_error(const Topology& topology, const Piece& piece, std::span<const Vec3d> x,
                                       const std::vector<Vec2d>& layout) {
  double error = 0, total = 0;
  for (std::uint32_t f : piece.triangles) {
    const Triangle& v = topology.triangles()[f];
    for (int k = 0; k < 3; ++k) {
      const double length = (x[v[k]] - x[v[(k + 1) % 3]]).norm();
      const double difference = (layout[v[k]] - layout[v[(k + 1) % 3]]).norm() - length;
      error += difference * difference;
      total += length * length;
    }
  }
  return {error, total};
}

void orient(const Topology& topology, const Piece& piece, std::vector<Vec2d>& layout) {
  double area = 0;
  for (std::uint32_t f : piece.triangles) {
    const Triangle& v = topology.triangles()[f];
    area += cross(layout[v[1]] - layout[v[0]], layout[v[2]] - layout[v[0]]);
  }
  if (area < 0) {
    for (std::uint32_t i : piece.vertices) layout[i].y() = -layout[i].y();
  }
}

void project(const Piece& piece, std::span<const Vec3d> x, std::vector<Vec2d>& layout) {
  Vec3d mean = Vec3d::Zero();
  for (std::uint32_t i : piece.vertices) mean += x[i];
  mean /= static_cast<double>(piece.vertices.size());
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (std::uint32_t i : piece.vertices) covariance += (x[i] - mean) * (x[i] - mean).transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);
  const Vec3d along = solver.eigenvectors().col(2), across = solver.eigenvectors().col(1);
  for (std::uint32_t i : piece.vertices) layout[i] = {along.dot(x[i] - mean), across.dot(x[i] - mean)};
}

/// Places triangles next to each other, breadth first from the one nearest the centroid; a vertex reached from several
/// placed triangles at once takes the mean of its places. Exact for a developable mesh.
void unfold(const Topology& topology, const Piece& piece, std::span<const Vec3d> x, std::vector<Vec2d>& layout) {
  Vec3d mean = Vec3d::Zero();
  for (std::uint32_t i : piece.vertices) mean += x[i];
  mean /= static_cast<double>(piece.vertices.size());
  std::vector<bool> placed(topology.vertex_count(), false), done(topology.triangle_count(), false);
  const auto triangles = topology.triangles();
  std::vector<std::uint32_t> order = piece.triangles;
  const auto distance = [&](std::uint32_t f) {
    return ((x[triangles[f][0]] + x[triangles[f][1]] + x[triangles[f][2]]) / 3.0 - mean).squaredNorm();
  };
  std::stable_sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) { return distance(a) < distance(b); });
  struct Place {
    std::uint32_t vertex;
    Vec2d sum = Vec2d::Zero();
    int count = 0;
  };
  std::vector<std::uint32_t> front;
  std::vector<Place> places;
  std::vector<std::uint32_t> place_of(topology.vertex_count(), kNone);
  // the apex of a triangle whose side a-b is placed; it lies to the left of a-b as the triangle runs
  const auto apex_at = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    const double length = std::max((x[b] - x[a]).norm(), 1e-12);
    const double u = (x[c] - x[a]).dot(x[b] - x[a]) / (length * length);
    const double h = (x[c] - x[a] - u * (x[b] - x[a])).norm();
    const Vec2d d = layout[b] - layout[a];
    return Vec2d(layout[a] + u * d + h * Vec2d(-d.y(), d.x()) / std::max(d.norm(), 1e-12));
  };
  for (std::uint32_t seed : order) {
    if (done[seed]) continue;
    const Triangle& s = triangles[seed];
    if (!placed[s[0]]) layout[s[0]] = Vec2d::Zero(), placed[s[0]] = true;
    if (!placed[s[1]]) layout[s[1]] = layout[s[0]] + Vec2d((x[s[1]] - x[s[0]]).norm(), 0), placed[s[1]] = true;
    if (!placed[s[2]]) layout[s[2]] = apex_at(s[0], s[1], s[2]), placed[s[2]] = true;
    done[seed] = true;
    front.assign(1, seed);
    while (!front.empty()) {
      places.clear();
      std::vector<std::uint32_t> next;
      for (std::uint32_t f : front) {
        for (std::uint32_t edge : topology.triangle_edges()[f]) {
          if (edge == kNone) continue;
          const InteriorEdge& e = topology.interior_edges()[edge];
          const std::uint32_t g = e.left == f ? e.right : e.left;
          if (done[g]) continue;
          done[g] = true;
          next.push_back(g);
          for (int k = 0; k < 3; ++k) {
            const std::uint32_t a = triangles[g][k], b = triangles[g][(k + 1) % 3], c = triangles[g][(k + 2) % 3];
            if (placed[c] || !placed[a] || !placed[b]) continue;
            if (place_of[c] == kNone) place_of[c] = static_cast<std::uint32_t>(places.size()), places.push_back({c});
            Place& place = places[place_of[c]];
            place.sum += apex_at(a, b, c);
            ++place.count;
          }
        }
      }
      for (const Place& place : places) {
        layout[place.vertex] = place.sum / place.count;
        placed[place.vertex] = true;
        place_of[place.vertex] = kNone;
      }
      front.swap(next);
    }
  }
}

}  // namespace

RestPlane rest_plane(const Topology& topology, std::span<const Vec3f> positions_m) {
  RestPlane plane;
  label_components(topology, plane);
  plane.coordinates_m.assign(topology.vertex_count(), Vec2d::Zero());
  if (!topology.material_coordinates_m().empty()) {
    for (std::size_t i = 0; i < topology.vertex_count(); ++i) {
      plane.coordinates_m[i] = topology.material_coordinates_m()[i].cast<double>();
    }
    // a simulator may keep its material space mirrored
    for (const Piece& piece : pieces(topology, plane)) orient(topology, piece, plane.coordinates_m);
    return plane;
  }
  const std::span<const Vec3f> rest = topology.rest_positions_m().empty() ? positions_m : topology.rest_positions_m();
  std::vector<Vec3d> x(rest.size());
  for (std::size_t i = 0; i < rest.size(); ++i) x[i] = rest[i].cast<double>();
  double error = 0, total = 0;
  std::vector<Vec2d> unfolded(topology.vertex_count(), Vec2d::Zero());
  for (const Piece& piece : pieces(topology, plane)) {
    if (piece.triangles.empty()) continue;
    project(piece, x, plane.coordinates_m);
    orient(topology, piece, plane.coordinates_m);
    auto [piece_error, piece_total] = length_error(topology, piece, x, plane.coordinates_m);
    if (piece_error > 1e-6 * piece_total) {
      unfold(topology, piece, x, unfolded);
      orient(topology, piece, unfolded);
      const double unfolded_error = length_error(topology, piece, x, unfolded).first;
      if (unfolded_error < piece_error) {
        for (std::uint32_t i : piece.vertices) plane.coordinates_m[i] = unfolded[i];
        piece_error = unfolded_error;
      }
    }
    error += piece_error;
    total += piece_total;
  }
  plane.distortion = total > 0 ? std::sqrt(error / total) : 0;
  return plane;
}

RestPlane renumbered(const RestPlane& plane, const Transfer& transfer, const Topology& to) {
  RestPlane out;
  label_components(to, out);
  for (const Transfer::Origin& origin : transfer.origins) out.coordinates_m.push_back(plane.coordinates_m[origin.closest()]);
  out.distortion = plane.distortion;
  return out;
}

}  // namespace rustle::sheet
