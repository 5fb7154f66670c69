#include "server/analysis/region_mesh.h"

namespace rustle::analysis {

std::vector<sheet::Vec3f> RegionMesh::positions_m(std::span<const sheet::Vec3f> fine_m) const {
  if (!proxy) return {fine_m.begin(), fine_m.end()};
  std::vector<sheet::Vec3f> out;
  out.reserve(proxy->vertices.size());
  for (std::uint32_t i : proxy->vertices) out.push_back(fine_m[i]);
  return out;
}

std::vector<bool> RegionMesh::sampled(const std::vector<bool>& fine) const {
  if (!proxy) return fine;
  std::vector<bool> out;
  for (std::uint32_t i : proxy->vertices) out.push_back(fine[i]);
  return out;
}

std::vector<bool> RegionMesh::gathered(const std::vector<bool>& fine) const {
  if (!proxy) return fine;
  std::vector<bool> out(proxy->vertices.size(), false);
  for (std::size_t i = 0; i < fine.size(); ++i) {
    if (fine[i]) out[proxy->nearest[i]] = true;
  }
  return out;
}

std::vector<std::uint32_t> RegionMesh::triangles_of(std::span<const std::uint32_t> fine_vertices) const {
  const auto triangles = stencils.topology->triangles();
  std::vector<bool> marked(stencils.topology->vertex_count(), false);
  for (std::uint32_t i : fine_vertices) marked[proxy ? proxy->nearest[i] : i] = true;
  for (int least = 2; least > 0; --least) {
    std::vector<std::uint32_t> out;
    for (std::uint32_t f = 0; f < triangles.size(); ++f) {
      const sheet::Triangle& v = triangles[f];
      if (marked[v[0]] + marked[v[1]] + marked[v[2]] >= least) out.push_back(f);
    }
    if (!out.empty()) return out;
  }
  return {};
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
