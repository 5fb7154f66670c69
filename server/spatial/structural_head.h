#pragma once

#include "server/spatial/hrtf.h"

namespace rustle::spatial {

/// One ear's hearing of a far source by the structural model of a spherical head with pinnae (Brown and Duda 1998; C7), θ
/// the angle between the direction and the ear's axis, a the head's radius:
///   delay    -(a/c) cos θ below 90°, (a/c)(θ - π/2) above
///   shadow   y = b0 x + b1 x₁ - a1 y₁,   α = 1.05 + 0.95 cos(1.2 θ), W = c/(a fs),
///            b0 = (α+W)/(1+W), b1 = (W-α)/(1+W), a1 = (W-1)/(1+W)
///   pinna    x + Σ ρ_k x(t - τ_k),   τ_k = A_k cos(az/2) sin(D_k (90° - el)) + B_k in samples at 44.1 kHz
/// The filter stands kPinnaLead samples late, for the echoes' fractions of a sample, which the delay takes off again.
/// Ears 0 left, 1 right. Pure. \pre direction has unit length
Hrtf::Response structural_response(const Vec3& direction, int ear, double rate_hz);

inline constexpr int kPinnaLead = 8;

/// The model over the whole grid; a source straight ahead has the mono level. Exactly symmetric. Straight below, where the
/// pinna's formula depends on the azimuth that a direction has no longer, the mean over all azimuths.
Hrtf structural_head(double rate_hz);

}  // namespace rustle::spatial
