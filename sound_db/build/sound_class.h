#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>

namespace rustle::build {

/// What kind of sound a recording is of. Packs of paper are made from the first four; the last two are for comparison.
enum class SoundClass { kFlap, kClac, kCrumple, kSlide, kTear, kCloth };
inline constexpr std::array kSoundClasses = {SoundClass::kFlap,  SoundClass::kClac, SoundClass::kCrumple,
                                             SoundClass::kSlide, SoundClass::kTear, SoundClass::kCloth};

/// "flap", "clac", "crumple", "slide", "tear", "cloth": as build manifests name them.
std::string_view name(SoundClass sound_class);
std::optional<SoundClass> sound_class_of(std::string_view name);

/// A guess by the words of a path, the file's name before its folders': "bookFlip1" is a flap, "card-slide-3" a slide,
/// "paper-ripping" a tear. Nothing when no word tells.
std::optional<SoundClass> guessed_class(std::string_view path);

}  // namespace rustle::build
