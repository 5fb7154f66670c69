#pragma once

#include <cstdint>
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

/// A tear tip in one frame (T5).
struct TearEvent {
  std::uint64_t id = 0;  ///< stays with the tip
  double speed_m_per_s = 0;
  Vec3d position_m = Vec3d::Zero();
  Vec3d direction = Vec3d::Zero();
  Source source = Source::kDetected;
  std::vector<Resonator> resonators;
};

/// What one sheet did between its previous frame and this one.
struct Observation {
  sheet::SheetId sheet = 0;
  double time_s = 0;           ///< of the frame
  double previous_time_s = 0;  ///< of the frame before, == time_s for the first
  std::vector<CrumplingEvent> crumpling;
  std::vector<FrictionContact> friction;  ///< every component in contact now; an episode that is missing has ended
  std::vector<TearEvent> tears;
};

}  // namespace rustle::observation
