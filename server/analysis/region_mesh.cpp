#include "server/analysis/region_mesh.h"

namespace rustle::analysis {

std::span<const sheet::Vec4f> RegionMesh::positions_m(std::span<const sheet::Vec4f> fine_m,
                                                      std::vector<sheet::Vec4f>& out) const {
  if (!proxy) return fine_m;
  out.resize(proxy->vertices.size());
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = fine_m[proxy->vertices[i]];
  return out;
}

void RegionMesh::gather_marks(const std::vector<bool>& fine, std::vector<std::uint8_t>& out) const {
  out.assign(stencils.topology->vertex_count(), 0);
  for (std::size_t i = 0; i < fine.size(); ++i) out[proxy ? proxy->nearest[i] : i] |= fine[i] ? 1 : 0;
}

void RegionMesh::mark(std::span<const std::uint32_t> fine_vertices, std::vector<std::uint8_t>& marks) const {
  for (const std::uint32_t i : fine_vertices) {
    const std::uint32_t at = proxy ? proxy->nearest[i] : i;
    if (!proxy || proxy->vertices[at] == i) marks[at] = 1;
  }
}

void RegionMesh::gather_triangles(std::span<const std::uint32_t> fine_vertices, std::vector<std::uint8_t>& marks,
                                  std::vector<std::uint32_t>& out) const {
  out.clear();
  for (const std::uint32_t i : fine_vertices) marks[proxy ? proxy->nearest[i] : i] = 1;
  const auto triangles = stencils.topology->triangles();
  for (int least = 2; least > 0 && out.empty(); --least) {
    for (const std::uint32_t i : fine_vertices) {
      const std::uint32_t v = proxy ? proxy->nearest[i] : i;
      for (std::uint32_t k = stencils.triangle_start[v]; k < stencils.triangle_start[v + 1]; ++k) {
        const std::uint32_t f = stencils.triangles_around[k];
        const sheet::Triangle& t = triangles[f];
        if (marks[t[0]] + marks[t[1]] + marks[t[2]] >= least) out.push_back(f);
      }
    }
  }
  for (const std::uint32_t i : fine_vertices) marks[proxy ? proxy->nearest[i] : i] = 0;
}

RegionMesh region_mesh(const std::shared_ptr<const sheet::Topology>& topology, const sheet::RestPlane& plane,
                       const Parameters& parameters, bool may_be_coarse) {
  RegionMesh out;
  if (may_be_coarse && 2 * topology->triangle_count() > 3 * parameters.proxy_triangles) {
    out.proxy = sheet::coarse_proxy(*topology, plane, parameters.proxy_triangles);
  }
  if (out.proxy) {
    out.stencils = region_stencils(out.proxy->topology, sheet::rest_plane(*out.proxy->topology, {}), parameters);
  } else {
    out.stencils = region_stencils(topology, plane, parameters);
  }
  return out;
}

}  // namespace rustle::analysis
