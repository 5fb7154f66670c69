#include "server/report/colour.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

namespace rustle::report {
namespace {

constexpr Colour rgb(std::uint32_t hex) {
  return {((hex >> 16) & 0xff) / 255.0, ((hex >> 8) & 0xff) / 255.0, (hex & 0xff) / 255.0};
}

constexpr Theme kLight = {rgb(0xffffff), rgb(0xfbfaf7), rgb(0x1c1f26), rgb(0x596070), rgb(0xe4e2dc), rgb(0xb4b2ab),
                          rgb(0xc8501a), rgb(0x2468a8), rgb(0x9a3a94), rgb(0x3b7f6b), rgb(0x8a8f9a), rgb(0xb3262e)};
constexpr Theme kDark = {rgb(0x15171c), rgb(0x1b1e25), rgb(0xebe8e2), rgb(0xa5abb8), rgb(0x2d313a), rgb(0x4d535f),
                         rgb(0xff9a57), rgb(0x68b4f0), rgb(0xe68fdc), rgb(0x6fc7ab), rgb(0x7d8492), rgb(0xff6b6b)};

double encode_srgb(double linear) {
  const double x = std::clamp(linear, 0.0, 1.0);
  return x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1 / 2.4) - 0.055;
}

double decode_srgb(double x) {
  return x <= 0.04045 ? x / 12.92 : std::pow((x + 0.055) / 1.055, 2.4);
}

struct HeatPoint {
  double position, chroma, hue_deg;
};
/// Lightness runs linearly from kHeatDark to kHeatBright; these give the way round the hues.
constexpr double kHeatDark = 0.12, kHeatBright = 0.975;
constexpr std::array<HeatPoint, 7> kHeat = {{{0.00, 0.020, 280},
                                             {0.18, 0.105, 292},
                                             {0.38, 0.165, 325},
                                             {0.56, 0.190, 375},
                                             {0.72, 0.175, 402},
                                             {0.87, 0.135, 435},
                                             {1.00, 0.045, 462}}};

}  // namespace

const Theme& light_theme() {
  return kLight;
}
const Theme& dark_theme() {
  return kDark;
}

std::string_view ink_name(Ink ink) {
  constexpr std::array<std::string_view, kInks> names = {"background", "panel",    "text",    "muted", "grid", "frame",
                                                         "crumpling",  "friction", "tearing", "level", "peak", "limit"};
  return names[static_cast<std::size_t>(ink)];
}

std::string css_colour(const Colour& colour) {
  const auto byte = [](double x) { return static_cast<int>(std::lround(std::clamp(x, 0.0, 1.0) * 255)); };
  return fmt::format("#{:02x}{:02x}{:02x}", byte(colour.red), byte(colour.green), byte(colour.blue));
}

Colour from_oklch(double lightness, double chroma, double hue_deg) {
  const double hue = hue_deg * std::numbers::pi / 180;
  const double a = chroma * std::cos(hue), b = chroma * std::sin(hue);
  const double l = std::pow(lightness + 0.3963377774 * a + 0.2158037573 * b, 3);
  const double m = std::pow(lightness - 0.1055613458 * a - 0.0638541728 * b, 3);
  const double s = std::pow(lightness - 0.0894841775 * a - 1.2914855480 * b, 3);
  return {encode_srgb(4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s),
          encode_srgb(-1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s),
          encode_srgb(-0.0041960863 * l - 0.7034186147 * m + 1.7076147010 * s)};
}

double oklab_lightness(const Colour& colour) {
  const double r = decode_srgb(colour.red), g = decode_srgb(colour.green), b = decode_srgb(colour.blue);
  return 0.2104542553 * std::cbrt(0.4122214708 * r + 0.5363325363 * g + 0.0514459929 * b) +
         0.7936177850 * std::cbrt(0.2119034982 * r + 0.6806995451 * g + 0.1073969566 * b) -
         0.0040720468 * std::cbrt(0.0883024619 * r + 0.2817188376 * g + 0.6299787005 * b);
}

Colour mix(const Colour& a, const Colour& b, double amount) {
  const auto lerp = [amount](double x, double y) { return x + (y - x) * amount; };
  return {lerp(a.red, b.red), lerp(a.green, b.green), lerp(a.blue, b.blue)};
}

Colour heat_colour(double t) {
  t = std::clamp(t, 0.0, 1.0);
  std::size_t next = 1;
  while (next + 1 < kHeat.size() && t > kHeat[next].position) ++next;
  const HeatPoint &from = kHeat[next - 1], &to = kHeat[next];
  const double u = (t - from.position) / (to.position - from.position);
  return from_oklch(kHeatDark + (kHeatBright - kHeatDark) * t, from.chroma + (to.chroma - from.chroma) * u,
                    from.hue_deg + (to.hue_deg - from.hue_deg) * u);
}

Colour diverging_colour(double t) {
  t = std::clamp(t, -1.0, 1.0);
  const double strength = std::abs(t);
  return from_oklch(0.95 - 0.42 * strength, 0.17 * std::pow(strength, 0.8), t < 0 ? 255 : 28);
}

Colour category_colour(int category) {
  /// Neighbouring numbers lie far apart in hue; odd ones are a little darker.
  const int index = ((category % kCategories) + kCategories) % kCategories;
  return from_oklch(index % 2 == 0 ? 0.82 : 0.74, 0.095, 55 + 360.0 * ((index * 5) % kCategories) / kCategories);
}

}  // namespace rustle::report
