#include "server/analysis/sent_contacts.h"

#include <algorithm>
#include <memory>
#include <numeric>
#include <optional>
#include <utility>

#include "server/analysis/sheet_contact.h"

namespace rustle::analysis {
namespace {

using sheet::ContactPartner;
using sheet::kNone;
using sheet::MeshFrame;
using sheet::Topology;
using sheet::Triangle;
using sheet::Vec3d;
using sheet::Vec3f;

Vec3d tangential(const Vec3d& velocity, const Vec3d& normal) {
  return velocity - normal * normal.dot(velocity);
}

class SentContacts {
 public:
  explicit SentContacts(const SentContactInputs& inputs) : in_(inputs) {
    const Topology& topology = *in_.frame.topology;
    dual_m2_.assign(topology.vertex_count(), 0.0);
    normals_.assign(topology.vertex_count(), Vec3d::Zero());
    for (const Triangle& t : topology.triangles()) {
      const Vec3f& a = in_.frame.positions_m[t[0]];
      const Vec3d doubled = (in_.frame.positions_m[t[1]] - a).cross(in_.frame.positions_m[t[2]] - a).cast<double>();
      for (const std::uint32_t v : t) dual_m2_[v] += doubled.norm() / 6, normals_[v] += doubled;
    }
    patch_.triangles.resize(topology.triangle_count());
    std::iota(patch_.triangles.begin(), patch_.triangles.end(), 0u);
  }

  void add_to(ContactComponents& components, std::vector<observation::FrictionContact>& out) {
    const auto order = [](const ContactPartner& partner) {
      const auto* obstacle = std::get_if<sheet::ObstaclePartner>(&partner);
      return std::pair(partner.index(), obstacle ? obstacle->id : std::get<sheet::SheetPartner>(partner).id);
    };
    std::map<std::pair<std::size_t, std::uint32_t>, std::vector<const sheet::SentContact*>> by_partner;
    for (const sheet::SentContact& contact : *in_.frame.contacts) by_partner[order(contact.partner)].push_back(&contact);
    for (const auto& [key, contacts] : by_partner) add(contacts, components, out);
  }

 private:
  void add(const std::vector<const sheet::SentContact*>& sent, ContactComponents& components,
           std::vector<observation::FrictionContact>& out) {
    const ContactPartner& partner = sent.front()->partner;
    if (const auto* other = std::get_if<sheet::SheetPartner>(&partner)) {
      const NeighbourSheet* neighbour = find_neighbour(in_.surroundings, other->id);
      if (neighbour && other->id < in_.frame.sheet && lists_sheet(*neighbour->frame, in_.frame.sheet)) return;
    }
    struct Entry {
      Vec3d slip_sum = Vec3d::Zero();
      int count = 0;
      double force_n = -1;
    };
    std::map<std::uint32_t, Entry> by_vertex;
    for (const sheet::SentContact* contact : sent) {
      Entry& entry = by_vertex[contact->vertex];
      entry.slip_sum += contact->slip_velocity_m_per_s ? contact->slip_velocity_m_per_s->cast<double>()
                                                       : differenced_slip(contact->vertex, partner);
      ++entry.count;
      if (contact->normal_force_n) {
        entry.force_n = std::max(0.0, entry.force_n) + static_cast<double>(*contact->normal_force_n);
      }
    }
    patch_.vertices.clear();
    patch_.areas_m2.clear();
    patch_.slips_m_per_s.clear();
    patch_.partner_triangles.clear();
    std::vector<double> forces_n;
    for (const auto& [vertex, entry] : by_vertex) {
      patch_.vertices.push_back(vertex);
      patch_.areas_m2.push_back(dual_m2_[vertex]);
      patch_.slips_m_per_s.push_back(entry.slip_sum / entry.count);
      patch_.partner_triangles.push_back(kNone);
      forces_n.push_back(entry.force_n);
    }
    const std::size_t first = out.size();
    components.split(in_.frame, patch_, partner, surface_of(in_.surroundings, partner, in_.frame.sheet), false, out);
    std::vector<std::size_t> place(out.size() - first, 0);
    const auto component = components.component();
    for (std::size_t k = 0; k < component.size(); ++k) {
      observation::FrictionContact& contact = out[first + component[k]];
      contact.vertices[place[component[k]]++].normal_force_n = static_cast<float>(forces_n[k]);
      if (forces_n[k] >= 0) contact.normal_force_n = std::max(0.0, contact.normal_force_n) + forces_n[k];
      contact.source = observation::Source::kSent;
    }
  }

  /// Relative to the partner where the vertex is, without the part along the surface's normal.
  Vec3d differenced_slip(std::uint32_t vertex, const ContactPartner& partner) {
    if (!in_.velocities.known(vertex)) return Vec3d::Zero();
    const Vec3d velocity = in_.velocities.at(vertex);
    const Vec3d point_m = in_.frame.positions_m[vertex].cast<double>();
    const double range_m = 10 * in_.radius_m;
    if (const auto* obstacle = std::get_if<sheet::ObstaclePartner>(&partner)) {
      const auto found = in_.surfaces.find(obstacle->id);
      const auto closest = found == in_.surfaces.end() ? std::nullopt : found->second.closest(point_m, range_m);
      if (closest) return tangential(velocity - found->second.velocity_m_per_s(*closest), closest->normal);
    } else if (const NeighbourSheet* other = find_neighbour(in_.surroundings, std::get<sheet::SheetPartner>(partner).id)) {
      auto [surface, made] = sheets_.try_emplace(other->id);
      NeighbourNow& now = surface->second.now;
      if (made) {
        now.update(*other, in_.frame.time_s, in_.over_s, in_.longest_extrapolation_s);
        surface->second.closest =
            std::make_unique<ClosestOnSheet>(*other->frame->topology, now.positions_m, now.velocities, range_m);
      }
      if (!now.velocity_known) return Vec3d::Zero();
      const auto touch = surface->second.closest->find(point_m, range_m);
      if (touch) return tangential(velocity - touch->velocity_m_per_s, touch->normal);
    }
    return tangential(velocity, normals_[vertex].normalized());
  }

  struct Surface {
    NeighbourNow now;
    std::unique_ptr<ClosestOnSheet> closest;
  };

  const SentContactInputs& in_;
  std::vector<double> dual_m2_;
  std::vector<Vec3d> normals_;
  ContactPatch patch_;
  std::map<sheet::SheetId, Surface> sheets_;
};

}  // namespace

void NeighbourNow::update(const NeighbourSheet& neighbour, double time_s, double over_s, double longest_s) {
  const MeshFrame& frame = *neighbour.frame;
  positions_m = frame.positions_m;
  velocities = {};
  velocity_known = true;
  const double age_s = time_s - frame.time_s;
  if (age_s > std::max(longest_s, 2 * over_s)) return;
  if (!frame.velocities_m_per_s.empty()) {
    velocities.sent_m_per_s = frame.velocities_m_per_s;
  } else if (follows(frame, neighbour.previous)) {
    velocities.now_m = frame.positions_m;
    velocities.before_m = neighbour.previous->positions_m;
    velocities.interval_s = frame.time_s - neighbour.previous->time_s;
  } else {
    velocity_known = false;
    return;
  }
  const double on_s = std::clamp(age_s, -longest_s, longest_s);
  if (on_s == 0) return;
  moved_m.resize(frame.positions_m.size());
  for (std::uint32_t i = 0; i < moved_m.size(); ++i) {
    moved_m[i] = frame.positions_m[i] + (on_s * velocities.at(i)).cast<float>();
  }
  positions_m = moved_m;
}

const NeighbourSheet* find_neighbour(const SheetSurroundings& surroundings, sheet::SheetId id) {
  for (const NeighbourSheet& other : surroundings.others) {
    if (other.id == id && other.frame) return &other;
  }
  return nullptr;
}

bool lists_sheet(const MeshFrame& frame, sheet::SheetId id) {
  if (!frame.contacts) return false;
  return std::any_of(frame.contacts->begin(), frame.contacts->end(), [&](const sheet::SentContact& contact) {
    const auto* partner = std::get_if<sheet::SheetPartner>(&contact.partner);
    return partner && partner->id == id;
  });
}

std::string_view surface_of(const SheetSurroundings& surroundings, const ContactPartner& partner, sheet::SheetId self) {
  if (const auto* obstacle = std::get_if<sheet::ObstaclePartner>(&partner)) {
    const std::string_view named =
        surroundings.scene ? surroundings.scene->surface_material(obstacle->id) : std::string_view();
    return named.empty() ? surroundings.touched_surface : named;
  }
  const sheet::SheetId id = std::get<sheet::SheetPartner>(partner).id;
  if (id == self) return surroundings.material;
  for (const NeighbourSheet& other : surroundings.others) {
    if (other.id == id) return other.material;
  }
  return {};
}

void add_sent_contacts(const SentContactInputs& inputs, ContactComponents& components,
                       std::vector<observation::FrictionContact>& out) {
  SentContacts(inputs).add_to(components, out);
}

}  // namespace rustle::analysis
