#include "server/apps/toml_text.h"

#include <algorithm>

namespace rustle::apps {

tl::expected<std::string, TomlFault> careful_toml(std::string_view text) {
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  if (text.starts_with(kByteOrderMark)) text.remove_prefix(kByteOrderMark.size());
  std::string out;
  out.reserve(text.size());
  unsigned line = 1;
  char quote = 0;  // that a text on this line began with
  for (std::size_t k = 0; k < text.size(); ++k) {
    const char c = text[k];
    if (c == '#' && quote == 0) {
      k = std::min(text.find('\n', k), text.size()) - 1;
      continue;
    }
    out += c;
    if (c == '\n') {
      ++line;
      quote = 0;
    } else if (quote != 0) {
      if (c == quote) {
        quote = 0;
      } else if (c == '\\' && quote == '"' && k + 1 < text.size() && text[k + 1] != '\n') {
        out += text[++k];
      }
    } else if (c == '"' || c == '\'') {
      if (text.substr(k).starts_with(std::string(3, c)))
        return tl::unexpected(
            TomlFault{line, "a text of several lines begins here, and no setting has one; write it in a line"});
      quote = c;
    } else if (static_cast<unsigned char>(c) >= 0x80) {
      return tl::unexpected(TomlFault{line, "a letter beyond ASCII stands outside of quotes; put the text in quotes"});
    }
  }
  return out;
}

}  // namespace rustle::apps
