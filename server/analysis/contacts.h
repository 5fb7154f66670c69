#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "server/analysis/contact_components.h"
#include "server/analysis/contact_patch.h"
#include "server/analysis/obstacle_contact.h"
#include "server/analysis/sent_contacts.h"
#include "server/analysis/sheet_contact.h"
#include "server/analysis/surface_distance.h"
#include "server/analysis/surroundings.h"
#include "server/analysis/unfolded.h"
#include "server/observation/observation.h"
#include "server/scene/proximity.h"
#include "server/sheet/mesh_frame.h"

namespace rustle::analysis {

struct ContactParameters {
  ContactWeight weight;
  double self_exclusion_radii = 3.0;      ///< parts nearer along the surface than this many contact radii,
  double self_exclusion_edges = 2.5;      ///< or this many local edge lengths, do not touch each other
  double least_single_area_m2 = 0.2e-4;   ///< a lone vertex with a smaller dual area must touch in two frames running
  double least_area_m2 = 0.02e-4;         ///< no episode begins with a smaller contact area
  double longest_extrapolation_s = 0.05;  ///< a neighbour sheet's newest frame is moved on by its velocity no longer
};

/// One frame of a sheet and what is around it.
struct ContactInputs {
  const sheet::MeshFrame& frame;
  const sheet::MeshFrame* before;            ///< of the update before, of whatever topology; null: none, no episode goes on
  const SheetSurroundings& surroundings;     ///< the scene applies at the frame's time
  double radius_m;                           ///< of contact, above 0
  const sheet::Vec3f& origin_m;              ///< near the sheet
  std::span<const sheet::Vec4f> relative_m;  ///< [V] positions from there: sheet::relative_positions_m
};

/// Friction events of one sheet (P1): vertices within the contact radius of an obstacle, of another sheet or of another part
/// of the sheet itself, grouped into components connected along mesh edges, one partner each. Resting ones too, at speed 0.
///
/// Where only part of a triangle is within reach its contact area is integrated over it (ContactMeter), so that area and
/// speed do not depend on the resolution:
///   A_i = ∫ w(d) φ_i dA,   speed = Σ A_i |v_i| / Σ A_i
/// with d the distance of a place, w the weight (ContactWeight), φ its share of the touching vertices of its triangle, and
/// v_i the tangential velocity relative to the partner: mean direction and mean speed over the places of i.
/// Velocities are those sent, else positions differenced in double against the previous frame; after a change of topology
/// against the place of the same material point in the previous mesh, or without material coordinates taken as that of the
/// partner for one frame (speed 0). An obstacle's velocity is meant over the same interval, so one that carries the sheet is
/// silent.
/// Contacts that are sent replace proximity, an empty list too; they keep their slip velocity and normal force.
/// Two sheets in contact sound once: the one with the lower id reports the pair, unless only the other sends its contacts.
/// Of two parts of a sheet in contact the one with the lowest vertex is reported.
/// An id stays while a component shares vertices with the same partner's component of the frame before or, on another
/// topology, lies within reach of it; where components merge or split the largest overlap keeps it.
///
/// One tracker per sheet; analysis worker. Cost: linear in vertices. Once warm, on one topology and without sent contacts, a
/// frame allocates what it returns and nothing else.
class ContactTracker {
 public:
  explicit ContactTracker(ContactParameters parameters = {}) : parameters_(parameters) {}

  /// Frames come in time order. Ids are taken from `next_event_id`, which is counted on.
  std::vector<observation::FrictionContact> update(const ContactInputs& inputs, std::uint64_t& next_event_id);

  void reset();

 private:
  /// A component as it was in the frame before.
  struct Episode {
    std::uint64_t id = 0;  ///< 0: seen once, not reported yet
    sheet::ContactPartner partner;
    std::vector<std::uint32_t> vertices;
    sheet::Vec3d slip_m_per_s = sheet::Vec3d::Zero();  ///< mean, relative to the partner
  };
  struct Overlap {
    double area_m2;
    std::size_t contact, episode;
  };
  struct Neighbour {
    NeighbourNow now;
    PosedSheet posed;
    SheetContact contact;
  };

  struct State {
    std::vector<Episode> episodes;
    std::map<sheet::ObstacleId, scene::ObstacleSurface> surfaces;
    UnfoldedProof unfolded;
    std::optional<SurfaceDistance> along_surface;
    PosedSheet posed;  ///< the sheet itself, when it may meet a sheet
    SheetContact self;
    std::map<sheet::SheetId, Neighbour> neighbours;
  };

  /// Working memory, nothing of which is meant from one frame to the next.
  struct Scratch {
    ContactGeometry geometry;
    ContactMeter meter;
    ObstacleContact obstacle;
    ContactComponents components;
    std::vector<std::optional<sheet::Vec3d>> located_m_per_s;
    std::vector<observation::FrictionContact> found;
    std::vector<const NeighbourSheet*> others;
    std::vector<std::uint64_t> ids;   ///< of each contact found, kNoId: none yet
    std::vector<std::uint8_t> taken;  ///< each episode
    std::vector<Overlap> overlaps;
    std::vector<Episode> episodes;
    std::vector<sheet::Vec3d> expected_m;
  };

  /// What one update works on.
  struct Work {
    const sheet::MeshFrame& frame;
    const sheet::MeshFrame* before;  ///< may be null
    const SheetSurroundings& surroundings;
    double radius_m;
    double over_s = 0;     ///< the interval that velocities are differenced over, 0: instantaneous
    bool located = false;  ///< velocities across a change of topology have been made
  };

  VertexVelocities velocities(Work& work);
  void update_obstacles(const Work& work);
  void touch_obstacles(Work& work);
  void touch_itself(Work& work);
  void touch_others(Work& work);
  void keep_identities(const Work& work);
  void match_vertices();
  void match_places(const sheet::MeshFrame& frame, const sheet::MeshFrame& before, double reach_m);
  void assign_overlaps();
  bool lone(const observation::FrictionContact& contact, const sheet::MeshFrame& frame) const;
  std::vector<observation::FrictionContact> report(const sheet::MeshFrame& frame, std::uint64_t& next_event_id);

  ContactParameters parameters_;
  State state_;
  Scratch scratch_;
};

}  // namespace rustle::analysis
