#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <tl/expected.hpp>

namespace rustle::capture {

enum class ElementType { kF4, kF8, kI4, kI8, kU4, kU1, kBool };

/// An array as NumPy stores it, row after row.
struct NpyArray {
  ElementType type = ElementType::kF4;
  std::vector<std::size_t> shape;
  std::string data;  ///< little-endian, element_count() elements

  std::size_t element_count() const;
  std::string shape_text() const;  ///< such as "(240, 609, 3)"
  bool is_real() const { return type == ElementType::kF4 || type == ElementType::kF8; }

  /// The elements converted; f8 rounds to the nearest f4.
  std::vector<float> as_f32() const;
  std::vector<double> as_f64() const;
  /// \pre !is_real()
  std::vector<std::int64_t> as_i64() const;
};

/// Parses a `.npy` file of version 1, 2 or 3 (numpy.lib.format). Error: what is wrong and how to save it instead; for
/// Fortran order, big-endian and other element types than those above, and data shorter than the shape says.
tl::expected<NpyArray, std::string> parse_npy(std::string bytes);

}  // namespace rustle::capture
