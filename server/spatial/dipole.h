#pragma once

#include <cstddef>
#include <span>

#include "server/spatial/listener.h"
#include "server/spatial/receivers.h"

/// A vibrating piece of sheet as a dipole above reflecting planes (Schreck et al. 2016, eqs. 1-6; P10).
namespace rustle::spatial {

inline constexpr double kSpeedOfSound_m_per_s = 343.0;
inline constexpr int kMaxPlanes = 16;
inline constexpr int kMaxPaths = 1 + kMaxPlanes;
inline constexpr double kMinDistance_m = 0.05;      ///< gains stop growing here
inline constexpr double kMinCosineFloor = 0.1;      ///< -20 dB
inline constexpr double kTouchingHeight_m = 0.002;  ///< no image at this height above a plane or lower: the pack was
inline constexpr double kImagedHeight_m = 0.006;    ///< recorded touching; the whole image from here on
inline constexpr double kListenerFade_m = 0.02;     ///< a listener behind a plane hears no image in it

/// One resonator, as the listener's geometry sees it.
struct Emitter {
  Vec3 position_m;
  Vec3 normal{0, 0, 1};                   ///< unit length
  double cosine_floor = kMinCosineFloor;  ///< least |cos θ|: the spread of the sheet's normals
  SymmetricMatrix covariance_m2;          ///< of its parts' positions; zero: a point
  bool fades_when_touching = true;        ///< false: imaged at every height, as printed
};

/// One way from the emitter to a receiver.
struct Path {
  double gain = 0;     ///< pattern · reflection · |cos θ| / R, signed against the direct path
  double delay_s = 0;  ///< (R̃ - R)/c, R the direct way to the listener's centre; may be slightly negative at an ear
  double spread_s = 0;  ///< σ_t = √(nᵀ C n) ∂Δt/∂h: the cross term with the direct path fades as exp(-(ω σ_t)²/2)
  Vec3 arrival_m;       ///< from the receiver to the emitter or its image
};

/// The direct path and one image per plane: mirrored position and normal.
///   out[0] direct, out[1+k] in planes[k]; gain 0 where the plane does not reflect or is touched
/// |cos θ| is held at the emitter's floor; the sign of cos θ shows in the images, against the direct path:
///   g_0 = max(|cos θ_0|, floor)/R_0,   g_k = max(|cos θ_k|, floor)/R_k · p_0 p_k,   p = cos θ / max(|cos θ|, floor)
/// so a sheet that turns through edge-on keeps sounding and nothing jumps; above the floor it is eqs. 5 and 6. R is held
/// above kMinDistance_m in the gains. Emitters below a plane count as lying on it. Returns 1 + planes.size(). Pure, any
/// thread. A way that is not finite has gain 0. \pre out.size() > planes.size()
std::size_t paths(const Emitter& emitter, const Receiver& receiver, const Vec3& centre_m, std::span<const Plane> planes,
                  std::span<Path> out) noexcept;

}  // namespace rustle::spatial
