#include "sound_db/build/sound_class.h"

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <vector>

namespace rustle::build {

namespace {

struct Words {
  SoundClass sound_class;
  std::vector<std::string_view> beginnings;
};

/// In the order in which they decide: a page that is torn is a tear.
const std::vector<Words>& words_of_classes() {
  static const std::vector<Words> words = {
      {SoundClass::kTear, {"tear", "torn", "rip"}},
      {SoundClass::kCrumple, {"crumpl", "scrunch", "crinkl"}},
      {SoundClass::kCloth, {"cloth", "fabric", "curtain"}},
      {SoundClass::kSlide, {"slid", "shov", "friction", "rub", "scrap"}},
      {SoundClass::kFlap, {"flip", "flap", "page"}},
      {SoundClass::kClac, {"clac", "click", "fan"}},
  };
  return words;
}

/// Runs of letters in lower case; a capital begins a new one.
std::vector<std::string> words_of(std::string_view text) {
  std::vector<std::string> words(1);
  for (const char letter : text) {
    const auto c = static_cast<unsigned char>(letter);
    if (!std::isalpha(c) || std::isupper(c)) words.emplace_back();
    if (std::isalpha(c)) words.back() += static_cast<char>(std::tolower(c));
  }
  return words;
}

std::optional<SoundClass> class_by_words(std::string_view text) {
  const std::vector<std::string> words = words_of(text);
  for (const auto& [sound_class, beginnings] : words_of_classes()) {
    for (const std::string& word : words) {
      const auto begins = [&](std::string_view beginning) { return word.starts_with(beginning); };
      if (std::any_of(beginnings.begin(), beginnings.end(), begins)) return sound_class;
    }
  }
  return std::nullopt;
}

}  // namespace

std::string_view name(SoundClass sound_class) {
  constexpr std::string_view kNames[] = {"flap", "clac", "crumple", "slide", "tear", "cloth"};
  return kNames[static_cast<std::size_t>(sound_class)];
}

std::optional<SoundClass> sound_class_of(std::string_view wanted) {
  for (const SoundClass sound_class : kSoundClasses) {
    if (name(sound_class) == wanted) return sound_class;
  }
  return std::nullopt;
}

std::optional<SoundClass> guessed_class(std::string_view path) {
  const std::filesystem::path whole(path);
  if (const auto found = class_by_words(whole.stem().string())) return found;
  for (auto folder = whole.parent_path(); !folder.empty() && folder != folder.parent_path(); folder = folder.parent_path()) {
    if (const auto found = class_by_words(folder.filename().string())) return found;
  }
  return std::nullopt;
}

}  // namespace rustle::build
