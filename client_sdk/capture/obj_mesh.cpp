#include <charconv>
#include <cstddef>
#include <limits>
#include <optional>

#include <fmt/format.h>

#include "client_sdk/capture/text_words.h"
#include "client_sdk/capture/triangle_mesh.h"

namespace rustle::capture {
namespace {

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

std::optional<double> to_number(std::string_view word) {
  if (word.starts_with('+')) word.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc() || end != word.data() + word.size()) return std::nullopt;
  return value;
}

/// From 1 on, or from -1 back, to an index below `count`.
std::optional<std::uint32_t> to_index(std::string_view word, std::size_t count) {
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc() || end != word.data() + word.size()) return std::nullopt;
  const std::int64_t index = value < 0 ? static_cast<std::int64_t>(count) + value : value - 1;
  if (index < 0 || index >= static_cast<std::int64_t>(count)) return std::nullopt;
  return static_cast<std::uint32_t>(index);
}

class ObjParser {
 public:
  /// The text of what is wrong with the line, or nullopt.
  std::optional<std::string> take_line(std::string_view line) {
    line = line.substr(0, line.find('#'));
    const std::string_view keyword = take_word(line);
    if (keyword == "v") return take_numbers(line, 3, mesh_.positions);
    if (keyword == "vt") return take_numbers(line, 2, texture_);
    if (keyword == "f") return take_face(line);
    return std::nullopt;
  }

  TriangleMesh finish() {
    const std::size_t vertex_count = mesh_.positions.size() / 3;
    texture_of_vertex_.resize(vertex_count, kNone);
    bool one_each = vertex_count > 0 && !ambiguous_texture_;
    for (const std::uint32_t index : texture_of_vertex_) one_each = one_each && index != kNone;
    for (std::size_t i = 0; one_each && i < vertex_count; ++i) {
      mesh_.texture_coordinates.push_back(texture_[2 * texture_of_vertex_[i]]);
      mesh_.texture_coordinates.push_back(texture_[2 * texture_of_vertex_[i] + 1]);
    }
    return std::move(mesh_);
  }

 private:
  static std::optional<std::string> take_numbers(std::string_view line, int count, std::vector<float>& out) {
    for (int i = 0; i < count; ++i) {
      const std::string_view word = take_word(line);
      const auto number = to_number(word);
      if (!number) return fmt::format("\"{}\" is not the number that belongs here", word);
      out.push_back(static_cast<float>(*number));
    }
    return std::nullopt;
  }

  std::optional<std::string> take_face(std::string_view line) {
    corners_.clear();
    for (std::string_view word = take_word(line); !word.empty(); word = take_word(line)) {
      const std::size_t slash = word.find('/');
      const auto vertex = to_index(word.substr(0, slash), mesh_.positions.size() / 3);
      if (!vertex) return fmt::format("\"{}\" names no vertex before this line", word);
      corners_.push_back(*vertex);
      if (slash == std::string_view::npos) continue;
      const std::string_view texture_word = word.substr(slash + 1, word.find('/', slash + 1) - slash - 1);
      if (texture_word.empty()) continue;
      const auto texture = to_index(texture_word, texture_.size() / 2);
      if (!texture) return fmt::format("\"{}\" names no texture coordinate before this line", word);
      if (texture_of_vertex_.size() <= *vertex) texture_of_vertex_.resize(*vertex + 1, kNone);
      std::uint32_t& known = texture_of_vertex_[*vertex];
      if (known != kNone && known != *texture) ambiguous_texture_ = true;
      known = *texture;
    }
    if (corners_.size() < 3) return std::string("a face has three corners or more");
    for (std::size_t i = 2; i < corners_.size(); ++i) {
      mesh_.triangles.insert(mesh_.triangles.end(), {corners_[0], corners_[i - 1], corners_[i]});
    }
    return std::nullopt;
  }

  TriangleMesh mesh_;
  std::vector<float> texture_;
  std::vector<std::uint32_t> texture_of_vertex_;
  std::vector<std::uint32_t> corners_;
  bool ambiguous_texture_ = false;
};

}  // namespace

tl::expected<TriangleMesh, MeshError> parse_obj(std::string_view text) {
  ObjParser parser;
  for (std::size_t line_number = 1; !text.empty(); ++line_number) {
    const std::size_t end = text.find('\n');
    if (auto wrong = parser.take_line(text.substr(0, end))) {
      return tl::unexpected(MeshError{fmt::format("line {}", line_number), std::move(*wrong)});
    }
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
  }
  return parser.finish();
}

}  // namespace rustle::capture
