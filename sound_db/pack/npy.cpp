#include "sound_db/pack/npy.h"

#include <bit>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <optional>
#include <string_view>

#include <fmt/format.h>

namespace rustle::pack {

static_assert(std::endian::native == std::endian::little, "arrays are read as they lie in the file");

namespace {

constexpr std::string_view kMagic = "\x93NUMPY";
constexpr std::uintmax_t kMostBytes = 256u << 20;

/// What follows `'key':` in the header's dictionary, blanks skipped; empty when the key is missing.
std::string_view value_of(std::string_view header, std::string_view key) {
  for (const char quote : {'\'', '"'}) {
    const auto at = header.find(fmt::format("{}{}{}", quote, key, quote));
    if (at == std::string_view::npos) continue;
    const auto colon = header.find(':', at + key.size() + 2);
    if (colon == std::string_view::npos) return {};
    const auto start = header.find_first_not_of(" \t", colon + 1);
    return start == std::string_view::npos ? std::string_view{} : header.substr(start);
  }
  return {};
}

std::optional<std::vector<std::size_t>> parse_shape(std::string_view text) {
  const auto close = text.find(')');
  if (text.empty() || text.front() != '(' || close == std::string_view::npos) return std::nullopt;
  text = text.substr(1, close - 1);
  std::vector<std::size_t> shape;
  while (!text.empty()) {
    const auto start = text.find_first_not_of(" ,");
    if (start == std::string_view::npos) break;
    text.remove_prefix(start);
    std::size_t size = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), size);
    if (error != std::errc{} || size > kMostBytes) return std::nullopt;
    shape.push_back(size);
    text.remove_prefix(static_cast<std::size_t>(end - text.data()));
  }
  return shape;
}

template <class Number>
tl::expected<BasicArray<Number>, std::string> read_array(const std::filesystem::path& file) {
  std::error_code failed;
  const auto length = std::filesystem::file_size(file, failed);
  if (failed) return tl::unexpected(fmt::format("cannot be read ({})", failed.message()));
  if (length > kMostBytes) return tl::unexpected(fmt::format("{} bytes is too large", length));
  std::string bytes(length, '\0');
  std::ifstream stream(file, std::ios::binary);
  if (!stream.read(bytes.data(), static_cast<std::streamsize>(length))) return tl::unexpected(std::string("cannot be read"));

  const auto cut = [&] { return tl::unexpected(fmt::format("is cut short: it ends after {} bytes", length)); };
  if (bytes.size() < 10) return cut();
  if (std::string_view(bytes).substr(0, 6) != kMagic) return tl::unexpected(std::string("is not a NumPy .npy file"));
  const int major = static_cast<unsigned char>(bytes[6]);
  if (major != 1 && major != 2) return tl::unexpected(fmt::format("has .npy format {}, only 1 and 2 are read", major));
  std::size_t start = major == 1 ? 10 : 12;
  if (bytes.size() < start) return cut();
  std::size_t header_size = 0;
  for (std::size_t i = 8; i < start; ++i) header_size |= std::size_t{static_cast<unsigned char>(bytes[i])} << (8 * (i - 8));
  if (bytes.size() - start < header_size) return cut();
  const std::string_view header = std::string_view(bytes).substr(start, header_size);
  start += header_size;

  const auto type = value_of(header, "descr");
  const std::string_view element = type.size() > 4 ? type.substr(1, 3) : std::string_view{};
  const bool single = element == "<f4", wide = element == "<f8";
  if (!single && !wide) {
    return tl::unexpected(fmt::format("has elements of type {}, expected '<f4'", type.substr(0, type.find(','))));
  }
  const auto order = value_of(header, "fortran_order");
  const auto shape = parse_shape(value_of(header, "shape"));
  if (order.empty() || !shape || shape->empty() || shape->size() > 2) {
    return tl::unexpected(std::string("has no header with a shape of one or two dimensions"));
  }
  if (!order.starts_with("False") && shape->size() == 2) {
    return tl::unexpected(std::string("is stored in Fortran order, expected C order (numpy.ascontiguousarray)"));
  }
  std::size_t count = 1;
  for (const std::size_t size : *shape) {
    if (size == 0 || count > kMostBytes / size) return tl::unexpected(std::string("has an empty or impossible shape"));
    count *= size;
  }
  const std::size_t item = single ? sizeof(float) : sizeof(double);
  if (bytes.size() - start < count * item) return cut();
  if (bytes.size() - start > count * item) return tl::unexpected(std::string("is longer than its shape says"));

  BasicArray<Number> array{*shape, std::vector<Number>(count)};
  for (std::size_t i = 0; i < count; ++i) {
    if (single) {
      float value = 0;
      std::memcpy(&value, &bytes[start + i * item], item);
      array.values[i] = value;
    } else {
      double value = 0;
      std::memcpy(&value, &bytes[start + i * item], item);
      array.values[i] = static_cast<Number>(value);
    }
    if (!std::isfinite(array.values[i])) return tl::unexpected(fmt::format("has a value that is not finite at index {}", i));
  }
  return array;
}

template <class Number>
tl::expected<void, std::string> write_array(const std::filesystem::path& file, std::span<const Number> values,
                                            const std::string& shape) {
  std::string header = fmt::format("{{'descr': '<f{}', 'fortran_order': False, 'shape': ({}), }}", sizeof(Number), shape);
  header.append(63 - (10 + header.size()) % 64, ' ');
  header += '\n';
  std::string bytes(kMagic);
  bytes += {'\x01', '\x00', static_cast<char>(header.size() & 255), static_cast<char>(header.size() >> 8)};
  bytes += header;
  std::ofstream stream(file, std::ios::binary | std::ios::trunc);
  stream.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  std::string data(values.size_bytes(), '\0');
  if (!values.empty()) std::memcpy(data.data(), values.data(), data.size());
  stream.write(data.data(), static_cast<std::streamsize>(data.size()));
  stream.close();
  if (!stream) return tl::unexpected(std::string("cannot be written (disk full, or no permission)"));
  return {};
}

}  // namespace

tl::expected<Array, std::string> read_npy(const std::filesystem::path& file) {
  return read_array<float>(file);
}

tl::expected<BasicArray<double>, std::string> read_npy_double(const std::filesystem::path& file) {
  return read_array<double>(file);
}

tl::expected<void, std::string> write_npy(const std::filesystem::path& file, std::span<const float> values) {
  return write_array(file, values, fmt::format("{},", values.size()));
}

tl::expected<void, std::string> write_npy_rows(const std::filesystem::path& file, std::span<const float> values,
                                               std::size_t columns) {
  return write_array(file, values, fmt::format("{}, {}", values.size() / columns, columns));
}

tl::expected<void, std::string> write_npy_rows(const std::filesystem::path& file, std::span<const double> values,
                                               std::size_t columns) {
  return write_array(file, values, fmt::format("{}, {}", values.size() / columns, columns));
}

}  // namespace rustle::pack
