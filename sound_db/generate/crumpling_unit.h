#pragma once

#include <map>
#include <vector>

#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/random.h"
#include "sound_db/generate/paper.h"
#include "sound_db/pack/sound_pack.h"

namespace rustle::generate {

inline constexpr double kFlapCompression = 0.10;

/// The transforms that flaps are made with, kept from one to the next. One thread at a time.
class Workspace {
 public:
  dsp::RealFft& fft(int size);

 private:
  std::map<int, dsp::RealFft> ffts_;
};

/// Corner of a flap's spectrum, b 5200 (l_r / 0.1)^-0.4 (l_c / 0.2)^-0.33 Hz, b the paper's brightness.
double flap_corner_hz(const Paper& paper, const pack::GridPoint& point);

/// A flap: the sheet's whole bend (10 %) reversed. A snap after 1 ms and aftershocks (24 x size, log-uniform over 4-350 ms,
/// energies Pareto 1.4, together as strong as the snap), each started in one of five parts of the sheet; a part answers with
/// noise in ERB bands that decay with T60 = 2.2 / (η f), band energy by the corner, the part's own deviation from it and two
/// formants. 9 dB below: the lowest modes, and the noise of the sheet moving. 200 to 800 ms; energy ∝ size, size = a / a(10
/// x 10 cm). \pre point is not constrained
std::vector<float> flap(const Paper& paper, const pack::GridPoint& point, double rate_hz, dsp::Random random,
                        Workspace& workspace);

/// A clac: one to four facets of 5-25 mm, each a noise burst around 2-8 kHz with T60 < 20 ms. Its energy is 14 dB below that
/// of the 10 x 10 cm flap.
std::vector<float> clac(const Paper& paper, double rate_hz, dsp::Random random);

}  // namespace rustle::generate
