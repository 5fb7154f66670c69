#include "server/spatial/dipole.h"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace rustle::spatial {
namespace {

struct Radiated {
  double level;     ///< pattern · max(|cos θ|, floor) / R
  double polarity;  ///< cos θ / max(|cos θ|, floor)
  double distance_m;
};

Radiated radiated(const Vec3& from_m, const Vec3& normal, double floor, const Receiver& receiver) noexcept {
  const Vec3 way = receiver.position_m - from_m;
  const double distance = norm(way);
  const double inverse = distance > 1e-9 ? 1 / distance : 0;
  const double cosine = std::clamp(inverse * dot(way, normal), -1.0, 1.0);
  const double floored = std::max(std::abs(cosine), floor);
  const double incidence = -inverse * dot(way, receiver.axis);
  const double amplitude = receiver.scale * (1 + receiver.shape * incidence) / std::max(distance, kMinDistance_m);
  return {amplitude * floored, floored > 0 ? cosine / floored : 0, distance};
}

double fade(double x, double zero, double one) noexcept {
  return std::clamp((x - zero) / (one - zero), 0.0, 1.0);
}

}  // namespace

std::size_t paths(const Emitter& emitter, const Receiver& receiver, const Vec3& centre_m, std::span<const Plane> planes,
                  std::span<Path> out) noexcept {
  assert(out.size() > planes.size());
  const double centre_distance = norm(centre_m - emitter.position_m);
  const Radiated direct = radiated(emitter.position_m, emitter.normal, emitter.cosine_floor, receiver);
  out[0] = {direct.level, (direct.distance_m - centre_distance) / kSpeedOfSound_m_per_s, 0,
            emitter.position_m - receiver.position_m};
  for (std::size_t k = 0; k < planes.size(); ++k) {
    const Plane& plane = planes[k];
    const double signed_height = dot(emitter.position_m - plane.point_m, plane.normal);
    const double height = std::max(signed_height, 0.0);
    const Vec3 image_m = emitter.position_m - (height + signed_height) * plane.normal;
    const Vec3 image_normal = emitter.normal - (2 * dot(emitter.normal, plane.normal)) * plane.normal;
    const Radiated image = radiated(image_m, image_normal, emitter.cosine_floor, receiver);
    const double listener_height = dot(receiver.position_m - plane.point_m, plane.normal);
    const double touching = emitter.fades_when_touching ? fade(signed_height, kTouchingHeight_m, kImagedHeight_m) : 1;
    const double kept = plane.reflection * touching * fade(listener_height, 0, kListenerFade_m);
    const double rise = dot(receiver.position_m - image_m, plane.normal) / std::max(image.distance_m, 1e-9) +
                        dot(receiver.position_m - emitter.position_m, plane.normal) / std::max(direct.distance_m, 1e-9);
    const double height_spread_m = std::sqrt(std::max(0.0, quadratic_form(emitter.covariance_m2, plane.normal)));
    out[1 + k] = {kept * image.level * image.polarity * direct.polarity,
                  (image.distance_m - centre_distance) / kSpeedOfSound_m_per_s,
                  height_spread_m * std::abs(rise) / kSpeedOfSound_m_per_s, image_m - receiver.position_m};
  }
  const auto is_endless = [](const Path& path) { return !std::isfinite(path.gain) || !std::isfinite(path.delay_s); };
  std::replace_if(out.begin(), out.begin() + static_cast<std::ptrdiff_t>(1 + planes.size()), is_endless, Path{});
  return 1 + planes.size();
}

}  // namespace rustle::spatial
