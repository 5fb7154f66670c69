#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "server/analysis/regions.h"
#include "server/sheet/proxy.h"

namespace rustle::analysis {

/// The mesh that a sheet's regions are found on: the sheet itself, or a coarse proxy of a fine one (P3). What is gathered
/// goes into `out`, whose memory is used again.
struct RegionMesh {
  RegionStencils stencils;
  std::optional<sheet::Proxy> proxy;  ///< none: the sheet itself

  /// Of its vertices: those of the sheet themselves, or gathered.
  std::span<const sheet::Vec4f> positions_m(std::span<const sheet::Vec4f> fine_m, std::vector<sheet::Vec4f>& out) const;
  /// A proxy vertex is marked when any fine vertex closest to it is. \pre fine: one mark per vertex, or none
  void gather_marks(const std::vector<bool>& fine, std::vector<std::uint8_t>& out) const;
  /// Marks the vertices that are these, or on a proxy those of these that it has.
  void mark(std::span<const std::uint32_t> fine_vertices, std::vector<std::uint8_t>& marks) const;
  /// Triangles with two of the vertices at least, or else with one; some come twice. `marks`: [V] zero, and zero again
  /// after.
  void gather_triangles(std::span<const std::uint32_t> fine_vertices, std::vector<std::uint8_t>& marks,
                        std::vector<std::uint32_t>& out) const;
};

/// `may_be_coarse`: false when something refers to the sheet's own triangles.
[[nodiscard]] RegionMesh region_mesh(const std::shared_ptr<const sheet::Topology>& topology, const sheet::RestPlane& plane,
                                     const Parameters& parameters, bool may_be_coarse = true);

}  // namespace rustle::analysis
