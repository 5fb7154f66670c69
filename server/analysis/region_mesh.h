#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "server/analysis/regions.h"
#include "server/sheet/proxy.h"

namespace rustle::analysis {

/// The mesh that a sheet's regions are found on: the sheet itself, or a coarse proxy of a fine one (P3).
struct RegionMesh {
  RegionStencils stencils;
  std::optional<sheet::Proxy> proxy;  ///< none: the sheet itself

  [[nodiscard]] std::vector<sheet::Vec3f> positions_m(std::span<const sheet::Vec3f> fine_m) const;
  /// Marks of the proxy's own vertices.
  [[nodiscard]] std::vector<bool> sampled(const std::vector<bool>& fine) const;
  /// A proxy vertex is marked when any fine vertex closest to it is.
  [[nodiscard]] std::vector<bool> gathered(const std::vector<bool>& fine) const;
  /// Triangles with two marked vertices at least, or else with one.
  [[nodiscard]] std::vector<std::uint32_t> triangles_of(std::span<const std::uint32_t> fine_vertices) const;
};

/// `may_be_coarse`: false when something refers to the sheet's own triangles.
[[nodiscard]] RegionMesh region_mesh(const std::shared_ptr<const sheet::Topology>& topology, const sheet::RestPlane& plane,
                                     const Parameters& parameters, bool may_be_coarse = true);

}  // namespace rustle::analysis
