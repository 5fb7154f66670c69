#include "server/analysis/contact_components.h"

#include <algorithm>
#include <numeric>
#include <string>
#include <tuple>

namespace rustle::analysis {

using observation::FrictionContact;
using sheet::kNone;
using sheet::Triangle;
using sheet::Vec3d;

namespace {

/// What moves faster than anything was put elsewhere, and did not slide; squares of such speeds may be no numbers.
constexpr double kMostSlip_m_per_s = 1e6;

Vec3d slid(const Vec3d& slip_m_per_s) {
  return slip_m_per_s.squaredNorm() <= kMostSlip_m_per_s * kMostSlip_m_per_s ? slip_m_per_s : Vec3d::Zero();
}

}  // namespace

void ContactComponents::connect(const sheet::Topology& topology, const ContactPatch& patch) {
  place_.resize(topology.vertex_count(), kNone);
  for (std::uint32_t k = 0; k < patch.vertices.size(); ++k) place_[patch.vertices[k]] = k;
  parent_.resize(patch.vertices.size());
  std::iota(parent_.begin(), parent_.end(), 0u);
  const auto join = [&](std::uint32_t a, std::uint32_t b) {
    if (a == kNone || b == kNone || parent_[a] == parent_[b]) return;
    a = root(a);
    b = root(b);
    parent_[std::max(a, b)] = std::min(a, b);
  };
  for (const std::uint32_t t : patch.triangles) {
    const Triangle& v = topology.triangles()[t];
    const std::uint32_t a = place_[v[0]];
    const std::uint32_t b = place_[v[1]];
    const std::uint32_t c = place_[v[2]];
    join(a, b);
    join(b, c);
    if (b == kNone) join(c, a);
  }
  component_.resize(patch.vertices.size());
  count_ = 0;
  for (std::uint32_t k = 0; k < component_.size(); ++k) component_[k] = root(k) == k ? count_++ : component_[root(k)];
}

/// Leaves out a component whose main partner, by area touched, is one before it.
void ContactComponents::find_sounding(const sheet::Topology& topology, const ContactPatch& patch) {
  touched_.clear();
  for (std::uint32_t k = 0; k < patch.vertices.size(); ++k) {
    if (patch.partner_triangles[k] == kNone) continue;
    for (const std::uint32_t v : topology.triangles()[patch.partner_triangles[k]]) {
      if (place_[v] != kNone) touched_.push_back({component_[k], component_[place_[v]], k, patch.areas_m2[k]});
    }
  }
  std::sort(touched_.begin(), touched_.end(), [](const Touched& a, const Touched& b) {
    return std::tie(a.by, a.component, a.place) < std::tie(b.by, b.component, b.place);
  });
  for (std::size_t k = 0; k < touched_.size();) {
    const std::uint32_t by = touched_[k].by;
    std::uint32_t main = kNone;
    double most_m2 = 0;
    while (k < touched_.size() && touched_[k].by == by) {
      const std::uint32_t component = touched_[k].component;
      double area_m2 = 0;
      for (; k < touched_.size() && touched_[k].by == by && touched_[k].component == component; ++k) {
        area_m2 += touched_[k].area_m2;
      }
      if (area_m2 > most_m2) most_m2 = area_m2, main = component;
    }
    if (main < by) contact_of_[by] = kNone;
  }
}

void ContactComponents::split(const sheet::MeshFrame& frame, const ContactPatch& patch, const sheet::ContactPartner& partner,
                              std::string_view surface, bool once, std::vector<FrictionContact>& out) {
  if (place_.size() > frame.topology->vertex_count()) place_.clear();
  connect(*frame.topology, patch);
  sizes_.assign(count_, 0);
  for (const std::uint32_t c : component_) ++sizes_[c];
  slip_sums_.assign(count_, Vec3d::Zero());
  contact_of_.assign(count_, 0);
  if (once) find_sounding(*frame.topology, patch);
  for (std::uint32_t c = 0; c < count_; ++c) {
    if (contact_of_[c] == kNone) continue;
    contact_of_[c] = static_cast<std::uint32_t>(out.size());
    FrictionContact& contact = out.emplace_back();
    contact.partner = partner;
    contact.touched_surface = std::string(surface);
    contact.vertices.reserve(sizes_[c]);
  }
  for (std::size_t k = 0; k < patch.vertices.size(); ++k) {
    place_[patch.vertices[k]] = kNone;
    if (contact_of_[component_[k]] == kNone) continue;
    FrictionContact& contact = out[contact_of_[component_[k]]];
    const double area_m2 = patch.areas_m2[k];
    const Vec3d slip = slid(patch.slips_m_per_s[k]);
    contact.area_m2 += area_m2;
    contact.speed_m_per_s += area_m2 * slip.norm();
    contact.position_m += area_m2 * frame.positions_m[patch.vertices[k]].cast<double>();
    slip_sums_[component_[k]] += area_m2 * slip;
    contact.vertices.push_back({patch.vertices[k], slip.cast<float>(), static_cast<float>(area_m2), -1});
  }
  for (std::uint32_t c = 0; c < count_; ++c) {
    if (contact_of_[c] == kNone) continue;
    FrictionContact& contact = out[contact_of_[c]];
    if (!(contact.area_m2 > 0)) continue;
    contact.speed_m_per_s /= contact.area_m2;
    contact.position_m /= contact.area_m2;
    const double sum = slip_sums_[c].norm();
    if (sum > 0) contact.direction = slip_sums_[c] / sum;
  }
}

}  // namespace rustle::analysis
