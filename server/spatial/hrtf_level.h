#pragma once

#include <span>

#include "server/spatial/hrtf.h"

namespace rustle::spatial {

/// Scales all filters alike, so that what comes from straight ahead has the power of mono sound: the mean of |H|² over both
/// ears and over frequencies spaced evenly in logarithm from 100 Hz to 16 kHz (or 0.9 of the Nyquist frequency) becomes 1.
/// \pre responses as Hrtf takes them
void level_ahead(double rate_hz, std::span<Hrtf::Response> responses);

}  // namespace rustle::spatial
