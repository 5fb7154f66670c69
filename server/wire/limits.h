#pragma once

#include <cstddef>

namespace rustle::wire {

/// The protocol's version, as Hello and Announcement carry it.
inline constexpr unsigned kProtocolVersion = 1;

/// Bounds on what a client may send. Checked before anything is stored; what is refused changes nothing.
struct Limits {
  std::size_t message_bytes = std::size_t{64} << 20;  ///< of a stream message
  std::size_t control_bytes = std::size_t{1} << 20;   ///< of a control request
  std::size_t string_bytes = 256;
  std::size_t vertices = 200'000;   ///< of one topology or mesh obstacle
  std::size_t triangles = 200'000;  ///< of one topology or mesh obstacle

  /// A sheet's newest topology always stays. Of topologies that a newer one has replaced the most recently used
  /// `replaced_topologies` stay (an adaptive simulator sends a new one at every frame), of those sent ahead and not yet used
  /// the newest `waiting_topologies`; both together hold at most `kept_triangles`, replaced ones going first.
  std::size_t replaced_topologies = 64;
  std::size_t waiting_topologies = 1024;
  std::size_t kept_triangles = 4'000'000;

  std::size_t sheets = 64;
  std::size_t obstacles = 1024;
  std::size_t obstacle_triangles = 1'000'000;  ///< of all obstacles of a session together
  std::size_t contacts = 1'000'000;            ///< of one frame
  std::size_t contact_partners = 4096;
  std::size_t tear_tips = 1024;
  std::size_t regions = 200'000;
  std::size_t rulings = 1'000'000;
  std::size_t singular_points = 200'000;
  std::size_t gains = 1024;

  double time_s = 1e10;        ///< |time|; the seconds since 1970 fit
  double position_m = 1e5;     ///< |coordinate|, material coordinates and sizes too
  double speed_m_per_s = 1e5;  ///< |component|
  double normal_force_n = 1e9;
  double metres_per_unit_min = 1e-6;
  double metres_per_unit_max = 1e6;
};

}  // namespace rustle::wire
