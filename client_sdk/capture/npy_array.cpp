#include "client_sdk/capture/npy_array.h"

#include <cassert>
#include <charconv>
#include <cstring>
#include <optional>
#include <string_view>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "client_sdk/capture/mcap_format.h"

namespace rustle::capture {
namespace {

constexpr std::string_view kMagic("\x93NUMPY", 6);
constexpr std::uint64_t kMaxNpyHeaderBytes = 1u << 16;
constexpr std::size_t kMaxDimensions = 8;

std::size_t size_of(ElementType type) {
  switch (type) {
    case ElementType::kF8:
    case ElementType::kI8:
      return 8;
    case ElementType::kU1:
    case ElementType::kBool:
      return 1;
    default:
      return 4;
  }
}

std::optional<ElementType> element_type(std::string_view description) {
  if (description.size() != 3 || (description[0] != '<' && description[0] != '|')) return std::nullopt;
  const std::string_view kind = description.substr(1);
  if (kind == "f4") return ElementType::kF4;
  if (kind == "f8") return ElementType::kF8;
  if (kind == "i4") return ElementType::kI4;
  if (kind == "i8") return ElementType::kI8;
  if (kind == "u4") return ElementType::kU4;
  if (kind == "u1") return ElementType::kU1;
  if (kind == "b1") return ElementType::kBool;
  return std::nullopt;
}

/// The header: a Python dictionary of a string, a boolean and a tuple of integers.
class HeaderText {
 public:
  explicit HeaderText(std::string_view text) : rest_(text) {}

  void skip_spaces() {
    while (!rest_.empty() && (rest_[0] == ' ' || rest_[0] == '\n' || rest_[0] == '\t')) rest_.remove_prefix(1);
  }
  bool accept(std::string_view token) {
    skip_spaces();
    if (!rest_.starts_with(token)) return false;
    rest_.remove_prefix(token.size());
    return true;
  }
  std::optional<std::string> quoted() {
    skip_spaces();
    if (rest_.empty() || (rest_[0] != '\'' && rest_[0] != '"')) return std::nullopt;
    const std::size_t end = rest_.find(rest_[0], 1);
    if (end == std::string_view::npos) return std::nullopt;
    std::string text(rest_.substr(1, end - 1));
    rest_.remove_prefix(end + 1);
    return text;
  }
  std::optional<std::size_t> integer() {
    skip_spaces();
    std::size_t value = 0;
    const auto [end, error] = std::from_chars(rest_.data(), rest_.data() + rest_.size(), value);
    if (error != std::errc()) return std::nullopt;
    rest_.remove_prefix(static_cast<std::size_t>(end - rest_.data()));
    accept("L");
    return value;
  }

 private:
  std::string_view rest_;
};

struct Header {
  std::string description;
  bool fortran_order = false;
  std::vector<std::size_t> shape;
};

std::optional<Header> parse_header_text(std::string_view text) {
  HeaderText in(text);
  Header header;
  bool has_description = false, has_order = false, has_shape = false;
  if (!in.accept("{")) return std::nullopt;
  while (!in.accept("}")) {
    const auto key = in.quoted();
    if (!key || !in.accept(":")) return std::nullopt;
    if (*key == "descr") {
      const auto description = in.quoted();
      // A list here describes a structured array, which has no single element type.
      header.description = description ? *description : "structured";
      has_description = true;
      if (!description) return header;
    } else if (*key == "fortran_order") {
      header.fortran_order = in.accept("True");
      if (!header.fortran_order && !in.accept("False")) return std::nullopt;
      has_order = true;
    } else if (*key == "shape") {
      if (!in.accept("(")) return std::nullopt;
      while (!in.accept(")")) {
        const auto extent = in.integer();
        if (!extent || header.shape.size() == kMaxDimensions) return std::nullopt;
        header.shape.push_back(*extent);
        in.accept(",");
      }
      has_shape = true;
    } else {
      return std::nullopt;
    }
    in.accept(",");
  }
  if (!has_description || !has_order || !has_shape) return std::nullopt;
  return header;
}

template <typename Stored, typename Value>
std::vector<Value> converted(const NpyArray& array) {
  std::vector<Value> out(array.element_count());
  for (std::size_t i = 0; i < out.size(); ++i) {
    Stored stored;
    std::memcpy(&stored, array.data.data() + i * sizeof stored, sizeof stored);
    out[i] = static_cast<Value>(stored);
  }
  return out;
}

template <typename Value>
std::vector<Value> converted_to(const NpyArray& array) {
  switch (array.type) {
    case ElementType::kF4:
      return converted<float, Value>(array);
    case ElementType::kF8:
      return converted<double, Value>(array);
    case ElementType::kI4:
      return converted<std::int32_t, Value>(array);
    case ElementType::kI8:
      return converted<std::int64_t, Value>(array);
    case ElementType::kU4:
      return converted<std::uint32_t, Value>(array);
    case ElementType::kU1:
    case ElementType::kBool:
      return converted<std::uint8_t, Value>(array);
  }
  return {};
}

}  // namespace

std::size_t NpyArray::element_count() const {
  std::size_t count = 1;
  for (const std::size_t extent : shape) count *= extent;
  return count;
}

std::string NpyArray::shape_text() const {
  return shape.size() == 1 ? fmt::format("({},)", shape[0]) : fmt::format("({})", fmt::join(shape, ", "));
}

std::vector<float> NpyArray::as_f32() const {
  return converted_to<float>(*this);
}
std::vector<double> NpyArray::as_f64() const {
  return converted_to<double>(*this);
}
std::vector<std::int64_t> NpyArray::as_i64() const {
  assert(!is_real());
  return converted_to<std::int64_t>(*this);
}

tl::expected<NpyArray, std::string> parse_npy(std::string bytes) {
  FieldReader fields(bytes);
  if (fields.bytes(kMagic.size()) != kMagic) return tl::unexpected(std::string("is no .npy array"));
  const int major = fields.value<std::uint8_t>();
  fields.value<std::uint8_t>();
  if (major < 1 || major > 3)
    return tl::unexpected(fmt::format("is a .npy array of version {}; 1, 2 and 3 are read", major));
  const std::uint64_t header_size = major == 1 ? fields.value<std::uint16_t>() : fields.value<std::uint32_t>();
  if (header_size > kMaxNpyHeaderBytes) return tl::unexpected(std::string("has a damaged .npy header"));
  const std::string_view header_text = fields.bytes(header_size);
  if (fields.failed()) return tl::unexpected(std::string("ends within its .npy header"));
  const std::optional<Header> header = parse_header_text(header_text);
  if (!header) return tl::unexpected(std::string("has a damaged .npy header"));

  const std::optional<ElementType> type = element_type(header->description);
  if (!type) {
    return tl::unexpected(
        fmt::format("has elements of type '{}'; save it as float32, float64, int32, int64, uint8 or bool"
                    " (little-endian), for example with .astype('<f4')",
                    header->description));
  }
  if (header->fortran_order) {
    return tl::unexpected(std::string("is in Fortran order; save numpy.ascontiguousarray() of it"));
  }
  std::uint64_t needed = size_of(*type);
  for (const std::size_t extent : header->shape) {
    if (__builtin_mul_overflow(needed, static_cast<std::uint64_t>(extent), &needed)) {
      return tl::unexpected(std::string("states a shape too large to be right"));
    }
  }
  if (needed != fields.rest().size()) {
    return tl::unexpected(fmt::format("holds {} bytes where its shape asks for {}", fields.rest().size(), needed));
  }
  NpyArray array;
  array.type = *type;
  array.shape = header->shape;
  bytes.erase(0, bytes.size() - needed);
  array.data = std::move(bytes);
  return array;
}

}  // namespace rustle::capture
