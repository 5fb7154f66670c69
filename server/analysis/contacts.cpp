#include "server/analysis/contacts.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numeric>
#include <string>
#include <utility>

#include "server/scene/triangles.h"
#include "server/sheet/point_grid.h"

namespace rustle::analysis {
namespace {

using observation::FrictionContact;
using observation::Source;
using scene::Box;
using sheet::ContactPartner;
using sheet::kNone;
using sheet::MeshFrame;
using sheet::Topology;
using sheet::Triangle;
using sheet::Vec3d;
using sheet::Vec3f;

/// Finds material points in a mesh.
class MaterialLocator {
 public:
  explicit MaterialLocator(const Topology& topology) : topology_(topology) {
    const auto material = topology.material_coordinates_m();
    flat_m_.reserve(material.size());
    for (const auto& m : material) flat_m_.emplace_back(m.x(), m.y(), 0.0f);
    double extent_m = 0;
    for (const Triangle& t : topology.triangles()) extent_m += scene::triangle_box(t, flat_m_).sizes().maxCoeff();
    cell_m_ = topology.triangle_count() > 0 ? extent_m / static_cast<double>(topology.triangle_count()) : 0.0;
    if (cell_m_ > 0) grid_.build(topology.triangles(), flat_m_, cell_m_);
  }

  /// Where the material point is in `positions_m`; none when it lies outside the mesh.
  std::optional<Vec3d> find(const sheet::Vec2f& material_m, std::span<const Vec3f> positions_m) const {
    if (!(cell_m_ > 0)) return std::nullopt;
    const Vec3d query(static_cast<double>(material_m.x()), static_cast<double>(material_m.y()), 0.0);
    const double tolerance_m = 0.05 * cell_m_;
    double best2 = tolerance_m * tolerance_m;
    std::optional<Vec3d> best;
    const Vec3d reach = Vec3d::Constant(tolerance_m);
    grid_.visit_box(Box(Vec3d(query - reach), Vec3d(query + reach)), [&](std::uint32_t t) {
      const Triangle& v = topology_.triangles()[t];
      const scene::TrianglePoint on = scene::closest_on_triangle(query, flat_m_[v[0]].cast<double>(),
                                                                 flat_m_[v[1]].cast<double>(), flat_m_[v[2]].cast<double>());
      const double distance2 = (query - on.position_m).squaredNorm();
      if (distance2 > best2 || (best && distance2 == best2)) return true;
      best2 = distance2;
      best = on.barycentric[0] * positions_m[v[0]].cast<double>() + on.barycentric[1] * positions_m[v[1]].cast<double>() +
             on.barycentric[2] * positions_m[v[2]].cast<double>();
      return true;
    });
    return best;
  }

 private:
  const Topology& topology_;
  std::vector<Vec3f> flat_m_;
  double cell_m_ = 0;
  scene::TriangleGrid grid_;
};

VertexVelocities sent_velocities(const MeshFrame& frame) {
  VertexVelocities out;
  for (const Vec3f& v : frame.velocities_m_per_s) out.velocities_m_per_s.push_back(v.cast<double>());
  return out;
}

VertexVelocities differenced_velocities(std::span<const Vec3f> now_m, std::span<const Vec3f> before_m, double interval_s) {
  assert(now_m.size() == before_m.size());
  VertexVelocities out;
  out.velocities_m_per_s.resize(now_m.size());
  for (std::size_t i = 0; i < now_m.size(); ++i) {
    out.velocities_m_per_s[i] = (now_m[i].cast<double>() - before_m[i].cast<double>()) / interval_s;
  }
  return out;
}

/// Whether two frames are of one topology in time order.
bool follows(const MeshFrame& frame, const MeshFrame* previous) {
  return previous && frame.time_s > previous->time_s && previous->positions_m.size() == frame.positions_m.size() &&
         previous->topology == frame.topology;
}

/// Groups touching vertices that mesh edges connect: the component of each place of `vertices`, numbered in order of their
/// lowest vertices. \pre vertices ascending
std::vector<std::uint32_t> connected_components(const Topology& topology, std::span<const std::uint32_t> vertices) {
  std::vector<std::uint32_t> place(topology.vertex_count(), kNone);
  for (std::uint32_t k = 0; k < vertices.size(); ++k) place[vertices[k]] = k;
  std::vector<std::uint32_t> parent(vertices.size());
  std::iota(parent.begin(), parent.end(), 0u);
  const auto root = [&](std::uint32_t k) {
    while (parent[k] != k) k = parent[k] = parent[parent[k]];
    return k;
  };
  for (const Triangle& t : topology.triangles()) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = place[t[k]];
      const std::uint32_t b = place[t[(k + 1) % 3]];
      if (a == kNone || b == kNone) continue;
      const std::uint32_t ra = root(a);
      const std::uint32_t rb = root(b);
      parent[std::max(ra, rb)] = std::min(ra, rb);
    }
  }
  std::vector<std::uint32_t> component(vertices.size());
  std::uint32_t count = 0;
  for (std::uint32_t k = 0; k < vertices.size(); ++k) component[k] = root(k) == k ? count++ : component[root(k)];
  return component;
}

/// Splits a patch into contacts without ids, one a component.
std::vector<FrictionContact> contacts_of(const MeshFrame& frame, const ContactPatch& patch, const ContactPartner& partner,
                                         std::string_view surface, std::span<const std::uint32_t> component) {
  std::vector<FrictionContact> contacts;
  std::vector<Vec3d> slip_sums;
  for (std::size_t k = 0; k < patch.vertices.size(); ++k) {
    if (component[k] >= contacts.size()) {
      contacts.emplace_back();
      contacts.back().partner = partner;
      contacts.back().touched_surface = std::string(surface);
      slip_sums.push_back(Vec3d::Zero());
    }
    FrictionContact& contact = contacts[component[k]];
    const double area_m2 = patch.areas_m2[k];
    const Vec3d& slip = patch.slips_m_per_s[k];
    contact.area_m2 += area_m2;
    contact.speed_m_per_s += area_m2 * slip.norm();
    contact.position_m += area_m2 * frame.positions_m[patch.vertices[k]].cast<double>();
    slip_sums[component[k]] += area_m2 * slip;
    contact.vertices.push_back({patch.vertices[k], slip.cast<float>(), static_cast<float>(area_m2), -1});
  }
  for (std::size_t c = 0; c < contacts.size(); ++c) {
    FrictionContact& contact = contacts[c];
    if (!(contact.area_m2 > 0)) continue;
    contact.speed_m_per_s /= contact.area_m2;
    contact.position_m /= contact.area_m2;
    const double sum = slip_sums[c].norm();
    if (sum > 0) contact.direction = slip_sums[c] / sum;
  }
  return contacts;
}

/// Of components of one sheet that touch each other keeps the one with the lowest vertex.
void sound_once(const Topology& topology, const ContactPatch& patch, std::span<const std::uint32_t> component,
                std::vector<FrictionContact>& contacts) {
  std::vector<std::uint32_t> component_of(topology.vertex_count(), kNone);
  for (std::size_t k = 0; k < patch.vertices.size(); ++k) component_of[patch.vertices[k]] = component[k];
  std::vector<std::map<std::uint32_t, double>> touched_area(contacts.size());
  for (std::size_t k = 0; k < patch.vertices.size(); ++k) {
    if (patch.partner_triangles[k] == kNone) continue;
    for (const std::uint32_t v : topology.triangles()[patch.partner_triangles[k]]) {
      if (component_of[v] != kNone) touched_area[component[k]][component_of[v]] += patch.areas_m2[k];
    }
  }
  const auto main_partner = [&](std::size_t c) {
    std::uint32_t best = kNone;
    double most = 0;
    for (const auto& [other, area_m2] : touched_area[c]) {
      if (area_m2 > most) most = area_m2, best = other;
    }
    return best;
  };
  std::vector<FrictionContact> kept;
  for (std::size_t c = 0; c < contacts.size(); ++c) {
    const std::uint32_t other = main_partner(c);
    const bool sounds_there = other < c && other != kNone;
    if (!sounds_there) kept.push_back(std::move(contacts[c]));
  }
  contacts = std::move(kept);
}

/// A third of every triangle around a vertex. [V]
std::vector<double> dual_areas_m2(const Topology& topology, std::span<const Vec3f> positions_m) {
  std::vector<double> areas_m2(topology.vertex_count(), 0.0);
  for (const Triangle& t : topology.triangles()) {
    const Vec3f& a = positions_m[t[0]];
    const double share = static_cast<double>((positions_m[t[1]] - a).cross(positions_m[t[2]] - a).norm()) / 6;
    for (const std::uint32_t v : t) areas_m2[v] += share;
  }
  return areas_m2;
}

/// What update() works on.
struct Work {
  const MeshFrame& frame;
  const SheetSurroundings& surroundings;
  double radius_m;
  ContactGeometry geometry;
  VertexVelocities velocities;
  double over_s = 0;  ///< the interval that velocities were differenced over, 0: instantaneous
};

/// The neighbour as it is at the frame's time.
struct NeighbourNow {
  std::vector<Vec3f> positions_m;
  VertexVelocities velocities;
  bool velocity_known = true;
};

NeighbourNow neighbour_now(const NeighbourSheet& neighbour, const Work& work, double longest_s) {
  NeighbourNow now;
  const MeshFrame& frame = *neighbour.frame;
  now.positions_m = frame.positions_m;
  const double age_s = work.frame.time_s - frame.time_s;
  if (age_s > std::max(longest_s, 2 * work.over_s)) return now;  // it has stopped: it rests
  if (!frame.velocities_m_per_s.empty()) {
    now.velocities = sent_velocities(frame);
  } else if (follows(frame, neighbour.previous)) {
    now.velocities = differenced_velocities(frame.positions_m, neighbour.previous->positions_m,
                                            frame.time_s - neighbour.previous->time_s);
  } else {
    now.velocity_known = false;
    return now;
  }
  const double on_s = std::clamp(age_s, -longest_s, longest_s);
  if (on_s != 0) {
    for (std::size_t i = 0; i < now.positions_m.size(); ++i) {
      now.positions_m[i] += (on_s * now.velocities.velocities_m_per_s[i]).cast<float>();
    }
  }
  return now;
}

Box bounds_of(std::span<const Vec3f> positions_m) {
  Eigen::AlignedBox3f box;
  for (const Vec3f& p : positions_m) box.extend(p);
  return box.isEmpty() ? Box() : Box(box.min().cast<double>(), box.max().cast<double>());
}

Box grown(const Box& box, double by_m) {
  if (box.isEmpty()) return box;
  return {Vec3d(box.min() - Vec3d::Constant(by_m)), Vec3d(box.max() + Vec3d::Constant(by_m))};
}

void add_patch(const Work& work, const ContactPatch& patch, const ContactPartner& partner, std::string_view surface,
               bool once, std::vector<FrictionContact>& out) {
  if (patch.vertices.empty()) return;
  const std::vector<std::uint32_t> component = connected_components(*work.frame.topology, patch.vertices);
  std::vector<FrictionContact> contacts = contacts_of(work.frame, patch, partner, surface, component);
  if (once) sound_once(*work.frame.topology, patch, component, contacts);
  std::move(contacts.begin(), contacts.end(), std::back_inserter(out));
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

/// Contacts as the simulator reports them.
class SentContacts {
 public:
  SentContacts(const Work& work, std::map<sheet::ObstacleId, scene::ObstacleSurface>& surfaces, double longest_s)
      : work_(work),
        surfaces_(surfaces),
        longest_s_(longest_s),
        dual_m2_(dual_areas_m2(*work.frame.topology, work.frame.positions_m)) {}

  void add_to(std::vector<FrictionContact>& out) {
    const auto order = [](const ContactPartner& partner) {
      const auto* obstacle = std::get_if<sheet::ObstaclePartner>(&partner);
      return std::pair(partner.index(), obstacle ? obstacle->id : std::get<sheet::SheetPartner>(partner).id);
    };
    std::map<std::pair<std::size_t, std::uint32_t>, std::vector<const sheet::SentContact*>> by_partner;
    for (const sheet::SentContact& contact : *work_.frame.contacts) by_partner[order(contact.partner)].push_back(&contact);
    for (const auto& [key, contacts] : by_partner) add(contacts, out);
  }

 private:
  void add(const std::vector<const sheet::SentContact*>& sent, std::vector<FrictionContact>& out) {
    const ContactPartner& partner = sent.front()->partner;
    if (const auto* other = std::get_if<sheet::SheetPartner>(&partner)) {
      const NeighbourSheet* neighbour = find_neighbour(work_.surroundings, other->id);
      if (neighbour && other->id < work_.frame.sheet && lists_sheet(*neighbour->frame, work_.frame.sheet)) return;
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
    ContactPatch patch;
    std::vector<double> forces_n;
    for (const auto& [vertex, entry] : by_vertex) {
      patch.vertices.push_back(vertex);
      patch.areas_m2.push_back(dual_m2_[vertex]);
      patch.slips_m_per_s.push_back(entry.slip_sum / entry.count);
      patch.partner_triangles.push_back(kNone);
      forces_n.push_back(entry.force_n);
    }
    const auto component = connected_components(*work_.frame.topology, patch.vertices);
    auto contacts =
        contacts_of(work_.frame, patch, partner, surface_of(work_.surroundings, partner, work_.frame.sheet), component);
    std::vector<std::size_t> place(contacts.size(), 0);
    for (std::size_t k = 0; k < component.size(); ++k) {
      FrictionContact& contact = contacts[component[k]];
      contact.vertices[place[component[k]]++].normal_force_n = static_cast<float>(forces_n[k]);
      if (forces_n[k] >= 0) contact.normal_force_n = std::max(0.0, contact.normal_force_n) + forces_n[k];
    }
    for (FrictionContact& contact : contacts) {
      contact.source = Source::kSent;
      out.push_back(std::move(contact));
    }
  }

  /// Relative to the partner where the vertex is, without the part along the surface's normal.
  Vec3d differenced_slip(std::uint32_t vertex, const ContactPartner& partner) {
    if (!work_.velocities.known(vertex)) return Vec3d::Zero();
    const Vec3d velocity = work_.velocities.velocities_m_per_s[vertex];
    const Vec3d point_m = work_.frame.positions_m[vertex].cast<double>();
    const double range_m = 10 * work_.radius_m;
    if (const auto* obstacle = std::get_if<sheet::ObstaclePartner>(&partner)) {
      const auto found = surfaces_.find(obstacle->id);
      const auto closest = found == surfaces_.end() ? std::nullopt : found->second.closest(point_m, range_m);
      if (closest) return tangential(velocity - found->second.velocity_m_per_s(*closest), closest->normal);
    } else if (const NeighbourSheet* other = find_neighbour(work_.surroundings, std::get<sheet::SheetPartner>(partner).id)) {
      auto [surface, made] = sheets_.try_emplace(other->id);
      if (made) {
        surface->second.now = neighbour_now(*other, work_, longest_s_);
        surface->second.contact = std::make_unique<SheetContact>(*other->frame->topology, surface->second.now.positions_m,
                                                                 surface->second.now.velocities, range_m, nullptr);
      }
      if (!surface->second.now.velocity_known) return Vec3d::Zero();
      const auto touch = surface->second.contact->closest(point_m, range_m);
      if (touch) return tangential(velocity - touch->velocity_m_per_s, touch->normal);
    }
    return tangential(velocity, vertex_normal(vertex));
  }

  static Vec3d tangential(const Vec3d& velocity, const Vec3d& normal) { return velocity - normal * normal.dot(velocity); }

  Vec3d vertex_normal(std::uint32_t vertex) {
    if (normals_.empty()) {
      const Topology& topology = *work_.frame.topology;
      normals_.assign(topology.vertex_count(), Vec3d::Zero());
      for (std::size_t t = 0; t < topology.triangle_count(); ++t) {
        for (const std::uint32_t v : topology.triangles()[t]) {
          normals_[v] += work_.geometry.cross_products_m2[t].cast<double>();
        }
      }
    }
    return normals_[vertex].normalized();
  }

  struct Surface {
    NeighbourNow now;
    std::unique_ptr<SheetContact> contact;
  };

  const Work& work_;
  std::map<sheet::ObstacleId, scene::ObstacleSurface>& surfaces_;
  double longest_s_;
  std::vector<double> dual_m2_;
  std::vector<Vec3d> normals_;
  std::map<sheet::SheetId, Surface> sheets_;
};

}  // namespace

std::vector<FrictionContact> ContactTracker::update(const MeshFrame& frame, const MeshFrame* previous_same_topology,
                                                    const SheetSurroundings& surroundings, double contact_radius_m,
                                                    std::uint64_t& next_event_id) {
  assert(frame.topology && frame.positions_m.size() == frame.topology->vertex_count() && contact_radius_m > 0);
  if (frame.reset_history) {
    state_.episodes.clear();
    state_.topology.reset();
  }
  Work work{frame, surroundings, contact_radius_m, {}, {}, 0};
  work.geometry.update(frame);
  const bool has_previous = !frame.reset_history && follows(frame, previous_same_topology);
  const bool has_state = !has_previous && state_.topology && frame.time_s > state_.time_s;
  bool velocities_made = false;
  if (frame.velocities_m_per_s.empty()) {
    if (has_previous) work.over_s = frame.time_s - previous_same_topology->time_s;
    if (has_state) work.over_s = frame.time_s - state_.time_s;
  }
  const auto make_velocities = [&]() {
    if (velocities_made) return;
    velocities_made = true;
    if (!frame.velocities_m_per_s.empty()) {
      work.velocities = sent_velocities(frame);
    } else if (has_previous) {
      work.velocities = differenced_velocities(frame.positions_m, previous_same_topology->positions_m, work.over_s);
    } else if (has_state && state_.topology == frame.topology) {
      work.velocities = differenced_velocities(frame.positions_m, state_.positions_m, work.over_s);
    } else if (has_state && !frame.topology->material_coordinates_m().empty() &&
               !state_.topology->material_coordinates_m().empty()) {
      const MaterialLocator before(*state_.topology);
      const auto material = frame.topology->material_coordinates_m();
      work.velocities.velocities_m_per_s.assign(material.size(), Vec3d::Zero());
      work.velocities.unknown.assign(material.size(), false);
      for (std::size_t i = 0; i < material.size(); ++i) {
        const auto place_m = before.find(material[i], state_.positions_m);
        work.velocities.unknown[i] = !place_m;
        if (place_m) work.velocities.velocities_m_per_s[i] = (frame.positions_m[i].cast<double>() - *place_m) / work.over_s;
      }
    }
  };

  const Box reach = grown(work.geometry.bounds_m, contact_radius_m);
  if (surroundings.scene) {
    std::erase_if(state_.surfaces, [&](const auto& entry) { return !surroundings.scene->find(entry.first); });
    for (const auto& [id, track] : surroundings.scene->obstacles())
      state_.surfaces[id].update(track, frame.time_s, work.over_s);
  } else {
    state_.surfaces.clear();
  }

  std::vector<FrictionContact> contacts;
  if (frame.contacts) {
    make_velocities();
    SentContacts(work, state_.surfaces, parameters_.longest_extrapolation_s).add_to(contacts);
  } else if (!work.geometry.bounds_m.isEmpty()) {
    for (const auto& [id, obstacle] : state_.surfaces) {
      if (!obstacle.may_meet(reach)) continue;
      make_velocities();
      const ContactPartner partner = sheet::ObstaclePartner{id};
      ObstacleContact contact(obstacle, work.geometry.usual_edge_m);
      add_patch(work, measure_contact(work.geometry, contact, work.velocities, parameters_.weight, contact_radius_m),
                partner, surface_of(surroundings, partner, frame.sheet), false, contacts);
    }
    const double least_m = parameters_.self_exclusion_radii * contact_radius_m;
    if (!state_.along_surface || state_.along_surface->topology() != frame.topology ||
        state_.along_surface->least_m() != least_m) {
      state_.along_surface.emplace(frame.topology, frame.positions_m, least_m, parameters_.self_exclusion_edges);
    }
    if (!state_.along_surface->connected() || !surely_unfolded(work.geometry)) {
      make_velocities();
      SheetContact self(*frame.topology, frame.positions_m, work.velocities, contact_radius_m, &*state_.along_surface);
      const ContactPartner partner = sheet::SheetPartner{frame.sheet};
      add_patch(work, measure_contact(work.geometry, self, work.velocities, parameters_.weight, contact_radius_m), partner,
                surroundings.material, true, contacts);
    }
    std::vector<const NeighbourSheet*> others;
    for (const NeighbourSheet& other : surroundings.others) {
      // The pair is the lower id's to report, or that of the one that sends its contacts.
      if (other.frame && other.id > frame.sheet && !lists_sheet(*other.frame, frame.sheet)) others.push_back(&other);
    }
    std::sort(others.begin(), others.end(), [](const auto* a, const auto* b) { return a->id < b->id; });
    for (const NeighbourSheet* other : others) {
      if (!reach.intersects(grown(bounds_of(other->frame->positions_m), 0.1))) continue;
      const NeighbourNow now = neighbour_now(*other, work, parameters_.longest_extrapolation_s);
      if (!reach.intersects(bounds_of(now.positions_m))) continue;
      make_velocities();
      SheetContact surface(*other->frame->topology, now.positions_m, now.velocities, contact_radius_m, nullptr);
      const VertexVelocities none;
      add_patch(work,
                measure_contact(work.geometry, surface, now.velocity_known ? work.velocities : none, parameters_.weight,
                                contact_radius_m),
                sheet::SheetPartner{other->id}, other->material, false, contacts);
    }
  }

  keep_identities(contacts, frame, contact_radius_m, next_event_id);
  state_.topology = frame.topology;
  state_.positions_m = frame.positions_m;
  state_.time_s = frame.time_s;
  return contacts;
}

void ContactTracker::keep_identities(std::vector<FrictionContact>& contacts, const MeshFrame& frame, double reach_m,
                                     std::uint64_t& next_event_id) {
  struct Overlap {
    double area_m2;
    std::size_t contact, episode;
  };
  std::vector<Episode>& before = state_.episodes;
  std::vector<std::optional<std::uint64_t>> id(contacts.size());
  std::vector<bool> taken(before.size(), false);
  const auto assign = [&](std::vector<Overlap>& overlaps) {
    std::stable_sort(overlaps.begin(), overlaps.end(),
                     [](const Overlap& a, const Overlap& b) { return a.area_m2 > b.area_m2; });
    for (const Overlap& overlap : overlaps) {
      if (id[overlap.contact] || taken[overlap.episode]) continue;
      id[overlap.contact] = before[overlap.episode].id;
      taken[overlap.episode] = true;
    }
  };
  std::vector<Overlap> overlaps;
  if (state_.topology == frame.topology) {
    for (std::size_t e = 0; e < before.size(); ++e) {
      for (std::size_t c = 0; c < contacts.size(); ++c) {
        if (!(contacts[c].partner == before[e].partner)) continue;
        double shared_m2 = 0;
        bool any = false;
        auto mine = before[e].vertices.begin();
        for (const observation::VertexContact& vertex : contacts[c].vertices) {
          while (mine != before[e].vertices.end() && *mine < vertex.vertex) ++mine;
          if (mine == before[e].vertices.end() || *mine != vertex.vertex) continue;
          any = true;
          shared_m2 += static_cast<double>(vertex.area_m2);
        }
        if (any) overlaps.push_back({shared_m2, c, e});
      }
    }
    assign(overlaps);
    overlaps.clear();
  }
  const double interval_s = frame.time_s - state_.time_s;
  for (std::size_t e = 0; e < before.size(); ++e) {
    if (taken[e]) continue;
    std::vector<Vec3d> expected_m = before[e].positions_m;
    for (Vec3d& p : expected_m) p += interval_s * before[e].slip_m_per_s;
    const double spacing_m =
        std::sqrt(before[e].dual_area_m2 / std::max<double>(1.0, static_cast<double>(expected_m.size())));
    const double within_m = std::max(reach_m, 1.5 * spacing_m);
    std::optional<sheet::PointGrid<3>> grid;
    for (std::size_t c = 0; c < contacts.size(); ++c) {
      if (id[c] || !(contacts[c].partner == before[e].partner)) continue;
      if (!grid) grid.emplace(expected_m, within_m);
      double near_m2 = 0;
      bool any = false;
      for (const observation::VertexContact& vertex : contacts[c].vertices) {
        bool near = false;
        grid->within(frame.positions_m[vertex.vertex].cast<double>(), within_m, [&](std::uint32_t, double) { near = true; });
        any = any || near;
        if (near) near_m2 += static_cast<double>(vertex.area_m2);
      }
      if (any) overlaps.push_back({near_m2, c, e});
    }
  }
  assign(overlaps);

  std::vector<double> dual_m2;
  if (!contacts.empty()) dual_m2 = dual_areas_m2(*frame.topology, frame.positions_m);
  std::vector<Episode> now;
  std::vector<FrictionContact> reported;
  for (std::size_t c = 0; c < contacts.size(); ++c) {
    FrictionContact& contact = contacts[c];
    Episode episode{0, contact.partner, {}, {}, contact.speed_m_per_s * contact.direction, 0};
    for (const observation::VertexContact& vertex : contact.vertices) {
      episode.vertices.push_back(vertex.vertex);
      episode.positions_m.push_back(frame.positions_m[vertex.vertex].cast<double>());
      episode.dual_area_m2 += dual_m2[vertex.vertex];
    }
    const bool detected = contact.source == Source::kDetected;
    const bool tiny = detected && contact.area_m2 < parameters_.least_area_m2;
    const bool lone = detected && contact.vertices.size() == 1 && episode.dual_area_m2 < parameters_.least_single_area_m2;
    if (id[c] && *id[c] != 0) {
      contact.id = *id[c];
    } else if (!tiny && (id[c] || !lone)) {
      contact.id = next_event_id++;
    }
    episode.id = contact.id;
    now.push_back(std::move(episode));
    if (contact.id != 0) reported.push_back(std::move(contact));
  }
  state_.episodes = std::move(now);
  contacts = std::move(reported);
}

void ContactTracker::reset() {
  state_ = State();
}

}  // namespace rustle::analysis
