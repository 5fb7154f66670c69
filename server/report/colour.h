#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

/// Colours of the pictures: what a colour stands for, two themes, and colour maps. Pure.
namespace rustle::report {

/// sRGB, each 0 to 1.
struct Colour {
  double red = 0, green = 0, blue = 0;
  bool operator==(const Colour&) const = default;
};

/// What a colour stands for; a theme gives it a value, the page gives it one per colour scheme.
enum class Ink : std::uint8_t {
  kBackground,  ///< behind a picture
  kPanel,       ///< behind a plot
  kText,
  kMuted,  ///< axis labels and captions
  kGrid,
  kFrame,
  kCrumpling,
  kFriction,
  kTearing,
  kLevel,  ///< RMS
  kPeak,
  kLimit,  ///< lines not to be crossed
};
inline constexpr int kInks = 12;

using Theme = std::array<Colour, kInks>;

const Theme& light_theme();
const Theme& dark_theme();

/// "text", "crumpling" ...: the name of the page's CSS variable.
std::string_view ink_name(Ink ink);

/// "#rrggbb".
std::string css_colour(const Colour& colour);

/// The OKLCh colour of a lightness 0..1, a chroma (about 0..0.3) and a hue in degrees, clamped into sRGB.
Colour from_oklch(double lightness, double chroma, double hue_deg);

/// OKLab lightness, 0 (black) to 1 (white).
double oklab_lightness(const Colour& colour);

/// Linear mix in sRGB: 0 gives a, 1 gives b.
Colour mix(const Colour& a, const Colour& b, double amount);

/// Sequential map for levels, 0 (near black) over violet, red and amber to 1 (cream). Lightness is linear in `t`; `t` is
/// clamped.
Colour heat_colour(double t);

/// Diverging map for signed quantities, -1 (blue) over 0 (pale) to 1 (red), equally light at ±t; `t` is clamped.
Colour diverging_colour(double t);

inline constexpr int kCategories = 12;

/// One of kCategories tints for regions (taken modulo), light enough for dark lines on top.
Colour category_colour(int category);

}  // namespace rustle::report
