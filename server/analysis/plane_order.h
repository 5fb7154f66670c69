#pragma once

#include <cstdint>
#include <vector>

#include "server/analysis/stencil.h"

namespace rustle::analysis {

/// The points' indices, piece by piece, along a Hilbert curve over the rest plane: what is near there comes together.
[[nodiscard]] std::vector<std::uint32_t> along_hilbert_curve(const PlanePoints& points);

}  // namespace rustle::analysis
