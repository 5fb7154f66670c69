#pragma once

#include <filesystem>
#include <string>

#include <tl/expected.hpp>

#include "server/spatial/hrtf.h"

namespace rustle::spatial {

/// A measured head from a SOFA file (AES69, SimpleFreeFieldHRIR), made ready for a rate:
///   - of several distances the farthest counts;
///   - the power mean over the sphere and both ears becomes flat (diffuse-field equalisation: what loudspeaker and
///     microphones added goes away), then a source straight ahead gets the mono level;
///   - magnitudes, in dB, and delays are carried to the grid by a narrow Gaussian kernel over the angle; where nothing was
///     measured the nearest directions count;
///   - filters are minimum phase; what is left of the phase is the ear's delay, against the mean of both ears ahead.
/// Above the file's Nyquist frequency the magnitude stays as it is at 0.95 of it. Reads the file; allocates.
/// Error: a sentence that names the file, what is wrong and what to do.
[[nodiscard]] tl::expected<Hrtf, std::string> measured_head(const std::filesystem::path& sofa, double rate_hz);

}  // namespace rustle::spatial
