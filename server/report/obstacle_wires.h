#pragma once

#include <utility>
#include <vector>

#include "server/scene/scene.h"

namespace rustle::report {

using Segment = std::pair<scene::Vec3d, scene::Vec3d>;

/// Lines that show an obstacle's shape in the world: a plane as a grid around the foot of `centre_m`, reaching `radius_m`; a
/// box as its edges; a sphere as three great circles, a capsule as rings and meridians; a mesh as its edges. Pure. A plane
/// farther than 3 radii from the centre gives none. Points that are not finite are left out.
std::vector<Segment> obstacle_wires(const scene::Obstacle& obstacle, const scene::Vec3d& centre_m, double radius_m);

}  // namespace rustle::report
