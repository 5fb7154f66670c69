#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include "server/synthesis/cloth/feature_rows.h"
#include "sound_db/dsp/random.h"

/// Feature rows made up for the tests of this folder.
namespace rustle::cloth::made_up {

struct Features {
  std::vector<float> values;
  std::size_t dimensions = 3;
  std::vector<std::uint32_t> starts{0};

  FeatureRows rows() const { return {values, dimensions, starts}; }
  std::vector<float> row(std::size_t unit) const {
    const auto first = values.begin() + static_cast<std::ptrdiff_t>(unit * dimensions);
    return {first, first + static_cast<std::ptrdiff_t>(dimensions)};
  }
  Features part(std::size_t first, std::size_t count) const {
    const auto begin = values.begin() + static_cast<std::ptrdiff_t>(first * dimensions);
    return {{begin, begin + static_cast<std::ptrdiff_t>(count * dimensions)}, dimensions};
  }
};

/// A wander that keeps near the middle: like filtered features, each row close to the one before.
inline Features wander(std::size_t units, std::uint64_t seed, double step = 0.4, std::size_t dimensions = 3) {
  dsp::Random random(seed);
  Features out;
  out.dimensions = dimensions;
  std::vector<double> at(dimensions, 0.0);
  for (std::size_t i = 0; i < units; ++i) {
    for (double& x : at) {
      x = 0.995 * x + step * random.normal();
      out.values.push_back(static_cast<float>(x));
    }
  }
  return out;
}

}  // namespace rustle::cloth::made_up
