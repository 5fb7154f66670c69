#pragma once

#include <array>
#include <cstddef>
#include <map>
#include <span>
#include <vector>

#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/random.h"
#include "sound_db/generate/paper.h"

/// How a piece of paper answers a blow: noise, each band of it dying at its own rate.
namespace rustle::generate {

/// The transforms that units are made with, kept from one to the next. One thread at a time.
class Workspace {
 public:
  dsp::RealFft& fft(int size);

 private:
  std::map<int, dsp::RealFft> ffts_;
};

struct Formant {
  double centre_hz = 1000, gain_db = 0, width_octaves = 0.5;
};

/// Energy per Hz of a blow is shape². Below low_hz the dipole's two sides cancel (6 dB per octave and slope), above
/// corner_hz amplitude falls as f^-slope; two formants make a piece unlike the next.
struct Response {
  double corner_hz = 5000;
  double low_hz = 300;
  double low_order = 1;
  double slope = 1.6;
  std::array<Formant, 2> formants{};

  double shape(double frequency_hz) const;
};

/// How blows ring: T60 = damping 2.2 / (η f), no longer than longest_s.
struct Ringing {
  double damping = 1;
  double longest_s = 10;
  double from_hz = 60;  ///< no sound below
};

/// One blow at time 0, heard for `length` samples: Gaussian noise in bands one ERB wide from from_hz to 0.47 of the rate,
/// the amplitude of a band ∝ shape / √T60 at the blow.
std::vector<float> blow(const Response& response, const Paper& paper, const Ringing& ringing, std::size_t length,
                        double rate_hz, dsp::Random& random, Workspace& workspace);

/// Steady Gaussian noise with amplitude density shape(f).
/// \pre length > 0
std::vector<float> shaped_noise(const Response& response, double from_hz, std::size_t length, double rate_hz,
                                dsp::Random& random, Workspace& workspace);

}  // namespace rustle::generate
