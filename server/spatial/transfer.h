#pragma once

#include <span>

#include "server/spatial/dipole.h"

namespace rustle::spatial {

/// Expected magnitude of what arrives by `ways` at one frequency (Schreck et al. 2016, eq. 6 without a³, P10's extended
/// source):
///   |H|² = |Σ_p γ_p g_p exp(-iωτ_p)|² + Σ_p (1 - γ_p²) g_p²,   γ = exp(-(ω σ_t)²/2)
/// For one plane: g₀² + g₁² + 2 g₀ g₁ cos(ωΔt) γ. Pure, any thread.
double magnitude(std::span<const Path> ways, double frequency_hz) noexcept;

}  // namespace rustle::spatial
