#include "server/apps/wording.h"

#include <fmt/format.h>

#include <utility>

namespace rustle::apps {

std::string counted(std::uint64_t count, std::string_view noun) {
  if (count == 1) return fmt::format("1 {}", noun);
  if (noun.ends_with('y')) return fmt::format("{} {}ies", count, noun.substr(0, noun.size() - 1));
  return fmt::format("{} {}s", count, noun);
}

std::string to_string(const Losses& losses) {
  const std::pair<std::uint64_t, std::pair<std::string_view, std::string_view>> kinds[] = {
      {losses.voices_stolen, {"voice", "stolen"}},
      {losses.voices_dropped, {"voice", "dropped"}},
      {losses.sources_dropped, {"friction source", "dropped"}},
      {losses.cues_dropped, {"cue", "dropped"}},
      {losses.sounds_missing, {"sound", "missing in the pack"}},
      {losses.planes_left_out, {"plane", "left out"}},
      {losses.samples_not_finite, {"sample", "not finite"}},
  };
  std::string text;
  for (const auto& [count, words] : kinds) {
    if (count > 0) text += fmt::format("{}{} {}", text.empty() ? "lost: " : ", ", counted(count, words.first), words.second);
  }
  return text.empty() ? "nothing lost" : text;
}

}  // namespace rustle::apps
