#pragma once

#include <string_view>

namespace rustle::capture {

/// Takes the first word off `text`, with the spaces before it; empty at the end.
inline std::string_view take_word(std::string_view& text) {
  constexpr std::string_view kSpaces = " \t\r\n";
  const std::size_t start = text.find_first_not_of(kSpaces);
  text.remove_prefix(start == std::string_view::npos ? text.size() : start);
  const std::string_view word = text.substr(0, text.find_first_of(kSpaces));
  text.remove_prefix(word.size());
  return word;
}

}  // namespace rustle::capture
