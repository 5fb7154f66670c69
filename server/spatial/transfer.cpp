#include "server/spatial/transfer.h"

#include <cmath>
#include <complex>
#include <numbers>

namespace rustle::spatial {

double magnitude(std::span<const Path> ways, double frequency_hz) noexcept {
  const double omega = 2 * std::numbers::pi * frequency_hz;
  std::complex<double> coherent = 0;
  double incoherent = 0;
  for (const Path& way : ways) {
    const double faded = omega * way.spread_s;
    const double coherence = std::exp(-0.5 * faded * faded);
    coherent += coherence * way.gain * std::polar(1.0, -omega * way.delay_s);
    incoherent += (1 - coherence * coherence) * way.gain * way.gain;
  }
  return std::sqrt(std::norm(coherent) + incoherent);
}

}  // namespace rustle::spatial
