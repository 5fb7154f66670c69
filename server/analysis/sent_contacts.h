#pragma once

#include <map>
#include <span>
#include <string_view>
#include <vector>

#include "server/analysis/contact_components.h"
#include "server/analysis/sheet_motion.h"
#include "server/analysis/surroundings.h"
#include "server/scene/proximity.h"

namespace rustle::analysis {

/// A neighbouring sheet as it is at another frame's time.
struct NeighbourNow {
  std::vector<sheet::Vec3f> moved_m;          ///< its positions when they had to be moved on
  std::span<const sheet::Vec3f> positions_m;  ///< of the neighbour's frame or moved_m
  VertexVelocities velocities;                ///< none: it rests
  bool velocity_known = true;

  /// Moves the newest frame on by its velocity to `time_s`, for `longest_s` at most; a frame older than that or than twice
  /// `over_s` has stopped. Views into the neighbour's frames.
  void update(const NeighbourSheet& neighbour, double time_s, double over_s, double longest_s);
};

const NeighbourSheet* find_neighbour(const SheetSurroundings& surroundings, sheet::SheetId id);  ///< with a frame, or null
bool lists_sheet(const sheet::MeshFrame& frame, sheet::SheetId id);                              ///< in its sent contacts

/// What the partner's surface is called: the obstacle's own name, else the sheet's touched surface; a sheet's material.
std::string_view surface_of(const SheetSurroundings& surroundings, const sheet::ContactPartner& partner,
                            sheet::SheetId self);

/// Contacts as the simulator reports them, a component each. Slip that was not sent is differenced against the partner
/// within ten radii, else against nothing. A pair of sheets that both list each other is left to the lower id.
struct SentContactInputs {
  const sheet::MeshFrame& frame;
  const SheetSurroundings& surroundings;
  const std::map<sheet::ObstacleId, scene::ObstacleSurface>& surfaces;
  const VertexVelocities& velocities;
  double over_s;  ///< the interval that velocities were differenced over, 0: instantaneous
  double radius_m;
  double longest_extrapolation_s;
};
/// \pre inputs.frame.contacts
void add_sent_contacts(const SentContactInputs& inputs, ContactComponents& components,
                       std::vector<observation::FrictionContact>& out);

}  // namespace rustle::analysis
