#pragma once

#include <cstdint>
#include <map>

#include "server/synthesis/material.h"

namespace rustle::synthesis {

/// Energy and peak of crumpling units, worked out once each. [analysis worker]
class UnitLoudness {
 public:
  struct Figures {
    double energy = 0;  ///< Σ x²
    double peak = 0;    ///< max |x|
  };
  /// \pre the same pointer always means the same samples, until forget()
  const Figures& of(const float* unit, std::uint32_t samples);
  /// The material's units and slips are about to go.
  void forget(const Material& material);

 private:
  std::map<const float*, Figures> known_;  // looked up only, never run through
};

}  // namespace rustle::synthesis
