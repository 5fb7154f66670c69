#pragma once

#include "server/spatial/vector.h"

namespace rustle::spatial {

/// Who hears. Metres, z up.
struct Listener {
  Vec3 position_m{0, 0, 1};
  Vec3 forward{0, 0, -1};  ///< unit length
  Vec3 up{0, 1, 0};        ///< unit length, need not be perpendicular to forward
};

/// An infinite plane that reflects what is on the side of its normal.
struct Plane {
  Vec3 point_m;
  Vec3 normal{0, 0, 1};  ///< unit length
  double reflection = 1.0;
};

/// The listener's right: forward × up, unit length. Negating `up` negates it exactly. When `up` lies along `forward`, any
/// perpendicular direction that still changes its sign with `up`.
Vec3 right_axis(const Listener& listener) noexcept;

/// A vector from the listener in the coordinates of the head: x forward, y left, z up, made perpendicular to forward.
/// \pre forward has unit length
Vec3 head_coordinates(const Listener& listener, const Vec3& from_listener) noexcept;

}  // namespace rustle::spatial
