#include "server/spatial/listener.h"

namespace rustle::spatial {

Vec3 right_axis(const Listener& listener) noexcept {
  const Vec3 right = cross(listener.forward, listener.up);
  const double length = norm(right);
  if (length > 1e-6 && std::isfinite(length)) return (1.0 / length) * right;
  const Vec3& f = listener.forward;
  const Vec3 helper = std::abs(f.z) < 0.9 ? Vec3{0, 0, 1} : Vec3{0, 1, 0};
  const double sign = dot(f, listener.up) < 0 ? -1.0 : 1.0;
  return sign * normalized(cross(f, helper), {1, 0, 0});
}

Vec3 head_coordinates(const Listener& listener, const Vec3& from_listener) noexcept {
  const Vec3 right = right_axis(listener);
  return {dot(from_listener, listener.forward), -dot(from_listener, right),
          dot(from_listener, cross(right, listener.forward))};
}

}  // namespace rustle::spatial
