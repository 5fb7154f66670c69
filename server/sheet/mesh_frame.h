#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <variant>
#include <vector>

#include "server/sheet/topology.h"
#include "server/sheet/vector.h"

namespace rustle::sheet {

using SheetId = std::uint32_t;
using ObstacleId = std::uint32_t;

/// What a vertex touches.
struct ObstaclePartner {
  ObstacleId id;
  bool operator==(const ObstaclePartner&) const = default;
};
struct SheetPartner {  ///< another sheet, or another part of the same one
  SheetId id;
  bool operator==(const SheetPartner&) const = default;
};
using ContactPartner = std::variant<ObstaclePartner, SheetPartner>;

/// A contact as the simulator reports it.
struct SentContact {
  std::uint32_t vertex;
  ContactPartner partner;
  std::optional<Vec3f> slip_velocity_m_per_s;  ///< of the vertex relative to the partner; absent: differenced
  std::optional<float> normal_force_n;
};

/// The simulator's own partition of the sheet (paper sound 2016, section 4).
struct SentPartition {
  std::vector<std::uint32_t> triangle_regions;  ///< [T], kNone: in none
  std::vector<bool> region_curved;              ///< [R]
  struct Ruling {
    Vec3f start_m, end_m;
    std::uint32_t region;
  };
  std::vector<Ruling> rulings;
  struct SingularPoint {
    Vec3f position_m;
    bool on_border;
  };
  std::vector<SingularPoint> singular_points;
};

struct SentTearTip {
  std::uint32_t tip_id;
  Vec3f position_m;
  float speed_m_per_s;
  std::optional<Vec3f> direction;  ///< unit length
};

/// Positions of one sheet at one time, over an immutable shared topology. Metres, seconds, z up.
/// Made by `wire`, which has checked sizes, indices and finiteness.
struct MeshFrame {
  SheetId sheet = 0;
  double time_s = 0;
  std::shared_ptr<const Topology> topology;
  std::vector<Vec3f> positions_m;                    ///< [V]
  std::vector<Vec3f> velocities_m_per_s;             ///< [V] or empty: differenced from positions
  std::vector<bool> anchored;                        ///< [V] or empty: none
  bool reset_history = false;                        ///< compare with nothing before it
  std::optional<std::vector<SentContact>> contacts;  ///< replace proximity when present
  std::optional<SentPartition> partition;
  std::vector<SentTearTip> tear_tips;
};

}  // namespace rustle::sheet
