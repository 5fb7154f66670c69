#include <charconv>
#include <cstddef>
#include <cstring>
#include <optional>

#include <fmt/format.h>

#include "client_sdk/capture/mcap_format.h"
#include "client_sdk/capture/text_words.h"
#include "client_sdk/capture/triangle_mesh.h"

namespace rustle::capture {
namespace {

enum class Scalar { kI1, kU1, kI2, kU2, kI4, kU4, kF4, kF8 };

std::optional<Scalar> scalar_named(std::string_view name) {
  if (name == "char" || name == "int8") return Scalar::kI1;
  if (name == "uchar" || name == "uint8") return Scalar::kU1;
  if (name == "short" || name == "int16") return Scalar::kI2;
  if (name == "ushort" || name == "uint16") return Scalar::kU2;
  if (name == "int" || name == "int32") return Scalar::kI4;
  if (name == "uint" || name == "uint32") return Scalar::kU4;
  if (name == "float" || name == "float32") return Scalar::kF4;
  if (name == "double" || name == "float64") return Scalar::kF8;
  return std::nullopt;
}

struct Property {
  std::string name;
  Scalar type = Scalar::kF4;
  std::optional<Scalar> list_count;  ///< a list's length has this type
};

struct Element {
  std::string name;
  std::uint64_t count = 0;
  std::vector<Property> properties;
};

std::string_view take_line(std::string_view& text) {
  const std::size_t end = text.find('\n');
  std::string_view line = text.substr(0, end);
  text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
  if (line.ends_with('\r')) line.remove_suffix(1);
  return line;
}

/// Values of the body one after the other; nullopt at its end or where a word is no number.
class Values {
 public:
  Values(std::string_view body, bool binary) : body_(body), binary_(binary) {}

  std::optional<double> next(Scalar type) { return binary_ ? next_binary(type) : next_word(); }

 private:
  std::optional<double> next_word() {
    std::string_view word = take_word(body_);
    if (word.starts_with('+')) word.remove_prefix(1);
    double value = 0;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error != std::errc() || end != word.data() + word.size()) return std::nullopt;
    return value;
  }

  std::optional<double> next_binary(Scalar type) {
    switch (type) {
      case Scalar::kI1:
        return take<std::int8_t>();
      case Scalar::kU1:
        return take<std::uint8_t>();
      case Scalar::kI2:
        return take<std::int16_t>();
      case Scalar::kU2:
        return take<std::uint16_t>();
      case Scalar::kI4:
        return take<std::int32_t>();
      case Scalar::kU4:
        return take<std::uint32_t>();
      case Scalar::kF4:
        return take<float>();
      case Scalar::kF8:
        return take<double>();
    }
    return std::nullopt;
  }

  template <typename Stored>
  std::optional<double> take() {
    if (body_.size() < sizeof(Stored)) return std::nullopt;
    Stored stored;
    std::memcpy(&stored, body_.data(), sizeof stored);
    body_.remove_prefix(sizeof stored);
    return static_cast<double>(stored);
  }

  std::string_view body_;
  bool binary_;
};

struct PlyHeader {
  bool binary = false;
  std::vector<Element> elements;
};

tl::expected<PlyHeader, MeshError> take_header(std::string_view& bytes) {
  PlyHeader header;
  bool has_format = false;
  std::size_t line_number = 1;
  const auto fail = [&](std::string message) {
    return tl::unexpected(MeshError{fmt::format("line {}", line_number), std::move(message)});
  };
  if (take_line(bytes) != "ply") return fail("does not begin with \"ply\"");
  while (true) {
    if (bytes.empty()) return fail("the header has no end_header");
    ++line_number;
    std::string_view line = take_line(bytes);
    const std::string_view keyword = take_word(line);
    if (keyword == "end_header") break;
    if (keyword == "format") {
      const std::string_view format = take_word(line);
      if (format != "ascii" && format != "binary_little_endian") {
        return fail(fmt::format("the format \"{}\" is not read, only ascii and binary_little_endian", format));
      }
      header.binary = format != "ascii";
      has_format = true;
    } else if (keyword == "element") {
      Element element;
      element.name = take_word(line);
      const std::string_view count = take_word(line);
      const auto [end, error] = std::from_chars(count.data(), count.data() + count.size(), element.count);
      if (error != std::errc() || end != count.data() + count.size()) return fail("an element needs a count");
      header.elements.push_back(std::move(element));
    } else if (keyword == "property") {
      if (header.elements.empty()) return fail("a property before any element");
      Property property;
      std::string_view type = take_word(line);
      if (type == "list") {
        property.list_count = scalar_named(take_word(line));
        if (!property.list_count) return fail("a list needs the type of its length");
        type = take_word(line);
      }
      const auto scalar = scalar_named(type);
      if (!scalar) return fail(fmt::format("\"{}\" is no type of PLY", type));
      property.type = *scalar;
      property.name = take_word(line);
      header.elements.back().properties.push_back(std::move(property));
    }
  }
  if (!has_format) return fail("the header states no format");
  return header;
}

/// Where in the mesh a property of the vertices goes: 0 to 2 position, 3 and 4 texture, -1 nowhere.
int destination_of(std::string_view property) {
  if (property == "x") return 0;
  if (property == "y") return 1;
  if (property == "z") return 2;
  if (property == "s" || property == "u" || property == "texture_u") return 3;
  if (property == "t" || property == "v" || property == "texture_v") return 4;
  return -1;
}

}  // namespace

tl::expected<TriangleMesh, MeshError> parse_ply(std::string_view bytes) {
  auto header = take_header(bytes);
  if (!header) return tl::unexpected(header.error());
  Values values(bytes, header->binary);
  TriangleMesh mesh;
  std::vector<std::uint32_t> corners;
  for (const Element& element : header->elements) {
    const bool is_vertex = element.name == "vertex";
    const bool is_face = element.name == "face";
    // An element without properties takes no bytes, so nothing bounds its count.
    if (element.properties.empty()) continue;
    for (std::uint64_t i = 0; i < element.count; ++i) {
      const auto fail = [&](std::string message) {
        return tl::unexpected(MeshError{fmt::format("{} {}", element.name, i), std::move(message)});
      };
      float vertex[5] = {};
      bool given[5] = {};
      for (const Property& property : element.properties) {
        std::uint64_t count = 1;
        if (property.list_count) {
          const auto length = values.next(*property.list_count);
          if (!length || !(*length >= 0 && *length <= 0xffffffffu)) {
            return fail("the file ends too early or a list's length is no number");
          }
          count = static_cast<std::uint64_t>(*length);
        }
        const bool is_corners =
            is_face && property.list_count && (property.name == "vertex_indices" || property.name == "vertex_index");
        const int destination = is_vertex && !property.list_count ? destination_of(property.name) : -1;
        corners.clear();
        for (std::uint64_t k = 0; k < count; ++k) {
          const auto value = values.next(property.type);
          if (!value) return fail("the file ends too early or holds a word that is no number");
          if (destination >= 0) {
            vertex[destination] = static_cast<float>(*value);
            given[destination] = true;
          }
          if (!is_corners) continue;
          if (!(*value >= 0 && *value < static_cast<double>(mesh.positions.size() / 3))) {
            return fail(fmt::format("asks for vertex {} of {}", *value, mesh.positions.size() / 3));
          }
          corners.push_back(static_cast<std::uint32_t>(*value));
        }
        if (is_corners && corners.size() < 3) return fail("a face has three corners or more");
        for (std::size_t k = 2; k < corners.size(); ++k) {
          mesh.triangles.insert(mesh.triangles.end(), {corners[0], corners[k - 1], corners[k]});
        }
      }
      if (!is_vertex) continue;
      if (!given[0] || !given[1] || !given[2]) return fail("has no x, y and z");
      mesh.positions.insert(mesh.positions.end(), vertex, vertex + 3);
      if (given[3] && given[4]) mesh.texture_coordinates.insert(mesh.texture_coordinates.end(), vertex + 3, vertex + 5);
    }
  }
  return mesh;
}

}  // namespace rustle::capture
