#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "server/analysis/curvature.h"
#include "server/observation/observation.h"
#include "server/sheet/rest_plane.h"
#include "server/sheet/topology.h"
#include "server/sheet/transfer.h"

/// How much and where a sheet is bent for good (P13). Crackling is dissipation: within its elastic range paper bends
/// silently, and only what goes beyond what it has borne before crackles. Per vertex a play operator (perfect plasticity
/// with kinematic hardening, the unit of Prandtl and Ishlinskii's model of hysteresis) follows the mean curvature H:
///   H_p stays while |H - H_p| <= H_y, else it follows so that |H - H_p| = H_y;   activity = ∫ |dH_p| dA, in metres
/// It is independent of rate: the same path gives the same sum at any frame rate, and a rigid motion gives none.
namespace rustle::analysis {

inline constexpr double kYieldCurvature_per_m = 10.0;  ///< H_y: of a cylinder of radius 5 cm
inline constexpr double kLeastYield_per_m = 0.25;      ///< beyond H_y, below which H_p rests: the noise of positions
inline constexpr double kRemeshSlack = 2.0;  ///< the same on a mesh just made: share of H's steps to its neighbours
inline constexpr std::uint32_t kMostPatches = 16;

/// The sheet cut into a coarse grid over its rest plane; everything about it that depends on the topology alone.
struct BendingPatches {
  sheet::Vec2d low_m = sheet::Vec2d::Zero(), extent_m = sheet::Vec2d::Ones();
  std::uint32_t columns = 1, rows = 1;
  std::vector<float> area_m2;                 ///< [V] a third of the triangles around, in the rest plane
  std::vector<std::uint8_t> of_vertex;        ///< [V]
  std::vector<sheet::Triangle> triangles;     ///< some of each patch, evenly taken
  std::vector<std::uint32_t> triangle_start;  ///< [patches + 1]
  std::array<double, kMostPatches> patch_area_m2{};

  std::uint32_t count() const { return columns * rows; }
  std::uint32_t at(const sheet::Vec2d& point_m) const;
};
[[nodiscard]] BendingPatches bending_patches(const sheet::Topology& topology, const sheet::RestPlane& plane);

/// H_p at the vertices; from the first remesh by material coordinates on, at points that stay with the material, so that
/// nothing is smeared from mesh to mesh.
struct BendingState {
  std::vector<float> stays_per_m;  ///< [points] H_p; empty: nothing is known
  std::vector<float> slack_per_m;  ///< [points] beyond H_y, within which H_p rests
  struct Samples {
    std::shared_ptr<const sheet::Topology> points;  ///< without triangles; null: the points are the vertices
    std::vector<sheet::Transfer::Origin> on_mesh;   ///< where they lie on the present topology
    std::vector<std::uint8_t> patch;
    float area_m2 = 0;  ///< of each
  } samples;
  std::vector<float> ranked_per_m;    ///< |H_p| by rank, rising, of a sheet whose vertices could not be followed; else empty
  std::vector<float> gathered_per_m;  ///< scratch: H at the samples
};

struct BendingInputs {
  const BendingPatches& patches;
  const CurvatureStencils& stencils;
  std::span<const float> mean_per_m;         ///< [V] H
  std::span<const sheet::Vec4f> relative_m;  ///< [V] in space, relative to origin_m
  sheet::Vec3d origin_m;
  bool remeshed = false;  ///< the topology is new: H differs by what the mesh is, most where it is steepest
};

/// Takes one frame. The first takes the sheet as bent from flat to its shape, and counts nothing. Appends the patches that
/// changed. O(points) over two arrays; allocates only what it returns, once the state has its size.
void find_bending(const BendingInputs& inputs, BendingState& state, std::vector<observation::BendingPatch>& out);

/// Moves the state to a new topology with the same vertices, renumbered or welded.
void carry(const sheet::Transfer& transfer, BendingState& state);

/// To any topology of the same material. `before`: the patches of `from`. \pre both have material coordinates
void carry_by_material(const sheet::Topology& from, const BendingPatches& before, const sheet::Topology& to,
                       BendingState& state);

/// To a topology of which nothing is known: the next find_bending gives each vertex the H_p of its rank in |H|, by area.
/// What bends further is counted; what bends in one place while it unbends in another is not.
void carry_by_rank(const BendingPatches& before, BendingState& state);

}  // namespace rustle::analysis
