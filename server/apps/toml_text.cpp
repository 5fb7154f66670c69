#include "server/apps/toml_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>

namespace rustle::apps {
namespace {

bool is_ascii(char c) {
  return static_cast<unsigned char>(c) < 0x80;
}

/// Takes the first letter off a text that is not empty. Absent: it is no UTF-8.
std::optional<std::uint32_t> take_letter(std::string_view& text) {
  const auto lead = static_cast<unsigned char>(text[0]);
  const std::size_t bytes = lead < 0x80 ? 1 : lead >= 0xf0 ? 4 : lead >= 0xe0 ? 3 : 2;
  if ((lead >= 0x80 && lead < 0xc2) || lead > 0xf4 || text.size() < bytes) return std::nullopt;
  std::uint32_t letter = bytes == 1 ? lead : lead & (0x7fu >> bytes);
  for (std::size_t k = 1; k < bytes; ++k) {
    const auto next = static_cast<unsigned char>(text[k]);
    if ((next & 0xc0) != 0x80) return std::nullopt;
    letter = letter << 6 | (next & 0x3f);
  }
  text.remove_prefix(bytes);
  return letter;
}

/// Where the text in quotes ends that begins at 0; npos: not on this line.
std::size_t end_of_quotes(std::string_view line) {
  for (std::size_t k = 1; k < line.size() && line[k] != '\n'; ++k) {
    if (line[k] == line[0]) return k;
    if (line[0] == '"' && line[k] == '\\') ++k;
  }
  return std::string_view::npos;
}

/// A text between double quotes that is the one between these, which may be of either kind. Absent: it is no UTF-8.
std::optional<std::string> escaped(std::string_view inside, char quote) {
  std::string out = "\"";
  while (!inside.empty()) {
    const char first = inside[0];
    const auto letter = take_letter(inside);
    if (!letter) return std::nullopt;
    if (!is_ascii(first)) {
      out += fmt::format("\\U{:08X}", *letter);
    } else {
      if (quote == '\'' && (first == '\\' || first == '"')) out += '\\';
      out += first;
    }
  }
  return out + '"';
}

}  // namespace

tl::expected<std::string, TomlFault> ascii_toml(std::string_view text) {
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  if (text.starts_with(kByteOrderMark)) text.remove_prefix(kByteOrderMark.size());
  std::string out;
  out.reserve(text.size());
  unsigned line = 1;
  const auto fault = [&](const char* what) { return tl::unexpected(TomlFault{line, what}); };
  for (std::size_t k = 0; k < text.size(); ++k) {
    const char c = text[k];
    if (c == '#') {
      k = std::min(text.find('\n', k), text.size()) - 1;
    } else if (c == '"' || c == '\'') {
      const std::string_view rest = text.substr(k);
      if (rest.starts_with(std::string(3, c)))
        return fault("a text of several lines begins here, and no setting has one; write it in a line");
      const std::size_t end = end_of_quotes(rest);
      if (end == std::string_view::npos) return fault("a text does not end on its line; close its quotes");
      const std::string_view whole = rest.substr(0, end + 1);
      if (std::all_of(whole.begin(), whole.end(), is_ascii)) {
        out += whole;
      } else if (const auto written = escaped(whole.substr(1, end - 1), c)) {
        out += *written;
      } else {
        return fault("a text is no UTF-8; save the file as UTF-8");
      }
      k += end;
    } else if (!is_ascii(c)) {
      return fault("a letter beyond ASCII stands outside of quotes; put the text in quotes");
    } else {
      line += c == '\n' ? 1 : 0;
      out += c;
    }
  }
  return out;
}

}  // namespace rustle::apps
