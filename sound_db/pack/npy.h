#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include <tl/expected.hpp>

/// NumPy's array file, format 1.0 and 2.0, little-endian float32 or float64 in C order, one or two dimensions.
namespace rustle::pack {

template <class Number>
struct BasicArray {
  std::vector<std::size_t> shape;  ///< [n] or [rows, n]
  std::vector<Number> values;      ///< row-major; float64 read as float32 is rounded
};
using Array = BasicArray<float>;

/// Reads a whole file. Anything else than promised above, a length that does not fit the shape, or a value that is not
/// finite is an error that says what was found.
[[nodiscard]] tl::expected<Array, std::string> read_npy(const std::filesystem::path& file);
[[nodiscard]] tl::expected<BasicArray<double>, std::string> read_npy_double(const std::filesystem::path& file);

/// Writes a one-dimensional float32 array, format 1.0, data aligned to 64 bytes.
[[nodiscard]] tl::expected<void, std::string> write_npy(const std::filesystem::path& file, std::span<const float> values);

/// Writes a two-dimensional array of `columns` columns, float32 or float64.
/// \pre values.size() is a multiple of columns
[[nodiscard]] tl::expected<void, std::string> write_npy_rows(const std::filesystem::path& file,
                                                             std::span<const float> values, std::size_t columns);
[[nodiscard]] tl::expected<void, std::string> write_npy_rows(const std::filesystem::path& file,
                                                             std::span<const double> values, std::size_t columns);

}  // namespace rustle::pack
