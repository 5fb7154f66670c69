#include "server/spatial/receivers.h"

#include <numbers>

namespace rustle::spatial {
namespace {

constexpr double kHalfSpacing_m = 0.085;
constexpr double kTurn_rad = 55.0 * std::numbers::pi / 180.0;

}  // namespace

std::array<Receiver, kMaxChannels> receivers(const Listener& listener, Layout layout) noexcept {
  std::array<Receiver, kMaxChannels> out;
  for (Receiver& receiver : out) receiver.position_m = listener.position_m;
  if (layout != Layout::kStereo) return out;
  const Vec3 right = right_axis(listener);
  const double cosine = std::cos(kTurn_rad);
  const double sine = std::sin(kTurn_rad);
  const std::array<Vec3, kMaxChannels> outward{-right, right};
  for (int c = 0; c < kMaxChannels; ++c) {
    out[c].position_m = listener.position_m + kHalfSpacing_m * outward[c];
    out[c].axis = cosine * listener.forward + sine * outward[c];
    out[c].shape = 1;
    out[c].scale = 1 / (1 + cosine);
  }
  return out;
}

}  // namespace rustle::spatial
