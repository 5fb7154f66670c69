#pragma once

#include <algorithm>
#include <cstddef>

#include "server/sheet/vector.h"

/// Work over a mesh in two steps: what its corners say is gathered into a batch, one load and one store a vector; then a
/// kernel goes over the batch in as many lanes as the processor has.
namespace rustle::sheet {

inline constexpr std::size_t kBatch = 128;  // enough that what is gathered has left the store buffer when it is read

/// Vectors of a batch: x, y, z, 0. Those that are not put keep what they were.
struct alignas(64) VectorBatch {
  float at[kBatch][4] = {};

  void put(std::size_t place, const Vec4f& vector) { Vec4f::MapAligned(at[place]) = vector; }
};

/// Calls put(k, place) for each k < count, and after every kBatch of them, and at the end, take(first k, how many).
template <class Put, class Take>
void in_batches(std::size_t count, Put&& put, Take&& take) {
  for (std::size_t first = 0; first < count; first += kBatch) {
    const std::size_t here = std::min(kBatch, count - first);
    for (std::size_t i = 0; i < here; ++i) put(first + i, i);
    take(first, here);
  }
}

}  // namespace rustle::sheet
