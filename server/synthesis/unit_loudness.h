#pragma once

#include <cstdint>
#include <map>

namespace rustle::synthesis {

/// Energy and peak of crumpling units, worked out once each. [analysis worker]
class UnitLoudness {
 public:
  struct Figures {
    double energy = 0;  ///< Σ x²
    double peak = 0;    ///< max |x|
  };
  /// \pre the same pointer always means the same samples
  const Figures& of(const float* unit, std::uint32_t samples);

 private:
  std::map<const float*, Figures> known_;  // looked up only, never run through
};

}  // namespace rustle::synthesis
