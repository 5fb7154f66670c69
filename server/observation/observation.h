#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "server/sheet/mesh_frame.h"
#include "server/sheet/vector.h"

/// The contract between analysis and synthesis: what the geometry did. Plain data. SI units.
namespace rustle::observation {

using sheet::Vec3d;

enum class Source { kDetected, kSent };

/// A part of the sheet that an event sets vibrating (paper sound 2016, sections 4 and 5).
struct Resonator {
  bool constrained = true;          ///< no free curved border: clac and flat friction; else flap and bent friction
  bool coarse = false;              ///< the mesh is too coarse here for the promised accuracy
  double ruling_length_m = 0;       ///< l_r, area-weighted mean of the rulings
  double free_border_length_m = 0;  ///< l_c, sum of the free curved borders
  double area_m2 = 0;
  Vec3d position_m = Vec3d::Zero();  ///< area centroid
  Vec3d normal = Vec3d::UnitZ();     ///< area-weighted mean, unit length
  double normal_spread = 0;          ///< rms of sin(angle to the mean normal), 0 flat to 1: sets the floor of |cos θ| (P10)
  Eigen::Matrix3d covariance_m2 = Eigen::Matrix3d::Zero();  ///< of the positions of its parts: along a plane's
                                                            ///< normal n the height spread is √(nᵀ C n) (P10)
  double disc_radius_m = 0;                                 ///< √(area/π)
  std::uint32_t number = 0;  ///< of the frame's, from 1: contacts that reach the same resonator name the same; 0: unknown
};

/// Connected vertices whose mean curvature changed sign the same way (P2).
struct CrumplingEvent {
  std::uint64_t id = 0;                  ///< unique within the session, from 1
  std::uint64_t continues = 0;           ///< the event it continues (P2's joining), 0: none
  double time_s = 0;                     ///< interpolated zero of H
  double confirmed_s = 0;                ///< time of the frame that showed it
  double amplitude_m = 0;                ///< Σ A |H(t) - H(t - 33 ms)|
  double published_amplitude_per_m = 0;  ///< Σ |ΔH| as the paper prints it
  double area_m2 = 0;
  int direction = 0;  ///< +1: now bent toward the normals
  Vec3d position_m = Vec3d::Zero();
  Vec3d velocity_m_per_s = Vec3d::Zero();  ///< of the sheet there
  std::vector<std::uint32_t> vertices;
  Source source = Source::kDetected;
  std::vector<Resonator> resonators;
};

/// A vertex that touches something (kept for cloth, P1).
struct VertexContact {
  std::uint32_t vertex = 0;
  sheet::Vec3f slip_velocity_m_per_s = sheet::Vec3f::Zero();
  float area_m2 = 0;          ///< contact area of the vertex
  float normal_force_n = -1;  ///< < 0: unknown
};

/// One connected component of touching vertices in one frame, sliding or resting (P1).
struct FrictionContact {
  std::uint64_t id = 0;  ///< of the episode: stays while the component persists, unique within the session
  sheet::ContactPartner partner;
  std::string touched_surface;  ///< of the partner; empty: the sheet's default
  double speed_m_per_s = 0;     ///< area-weighted mean tangential speed relative to the partner
  double area_m2 = 0;
  double normal_force_n = -1;  ///< < 0: unknown
  Vec3d position_m = Vec3d::Zero();
  Vec3d direction = Vec3d::Zero();  ///< mean slip direction, unit length or zero
  std::vector<VertexContact> vertices;
  Source source = Source::kDetected;
  std::vector<Resonator> resonators;
};

/// A tear tip in one frame (T5). One that stays where it is has the speed 0.
struct TearEvent {
  std::uint64_t id = 0;  ///< stays with the tip
  double speed_m_per_s = 0;
  double torn_m = 0;                    ///< by this tip since it was first seen
  std::uint32_t vertex = sheet::kNone;  ///< of the mesh; sent tips have none
  Vec3d position_m = Vec3d::Zero();
  Vec3d direction = Vec3d::Zero();
  Source source = Source::kDetected;
  std::vector<Resonator> resonators;
};

/// A part of the sheet that was bent for good since the frame before: where the events below what the mesh shows come from
/// (P13). A sheet has at most 16 parts, a coarse grid over its material.
struct BendingPatch {
  std::uint32_t patch = 0;           ///< 0 .. 15; the same part as long as the topology or its material coordinates stay
  double change_m = 0;               ///< ∫ |dH_p| dA, H_p the part of H that stays when the sheet is let go
  double area_m2 = 0;                ///< of the whole patch
  Vec3d position_m = Vec3d::Zero();  ///< centroid of what changed
  Vec3d normal = Vec3d::UnitZ();     ///< of the patch, unit length
  double normal_spread = 0;          ///< as a resonator's
  Eigen::Matrix3d covariance_m2 = Eigen::Matrix3d::Zero();  ///< of the places of what changed
};

/// By turn_rad about from_m, while that point goes to to_m.
struct RigidMotion {
  Vec3d from_m = Vec3d::Zero();
  Vec3d to_m = Vec3d::Zero();
  Vec3d turn_rad = Vec3d::Zero();  ///< axis times angle
};

/// What one sheet did between its previous frame and this one.
struct Observation {
  sheet::SheetId sheet = 0;
  double time_s = 0;                                ///< of the frame
  double previous_time_s = 0;                       ///< of the frame before, == time_s for the first
  std::shared_ptr<const sheet::Topology> topology;  ///< of the frame: what vertices are numbered by; null: unknown
  /// Where the mesh is made anew and the material was followed (P14): the vertex of the mesh before that each vertex is next
  /// to on the sheet. Empty where it is the same mesh, or nothing is known.
  std::vector<std::uint32_t> origins;
  std::vector<CrumplingEvent> crumpling;
  std::vector<FrictionContact> friction;  ///< every component in contact now; an episode that is missing has ended
  std::vector<TearEvent> tears;
  std::optional<RigidMotion> motion;  ///< of the sheet as a whole, while what crumpled in it may still sound
  std::vector<BendingPatch> bending;  ///< the patches that changed, by rising number
  std::size_t events_joined = 0;      ///< flips that sound in the frame's greatest ones, for want of time
  bool unidentified = false;  ///< the mesh is made anew and has no material coordinates: no crumpling is heard where it is
};

}  // namespace rustle::observation
