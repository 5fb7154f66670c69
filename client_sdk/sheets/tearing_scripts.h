#pragma once

#include <array>
#include <memory>
#include <span>
#include <string_view>

#include "client_sdk/sheets/sheet_stream.h"
#include "client_sdk/sheets/tearing_sheet.h"

namespace rustle::sheets {

/// Hands that tear a sheet from one border to the other, from a script:
///   slow        both turn slowly, grip farther on, and turn again, until the sheet is in two
///   fast        the same, three times as fast
///   one_handed  the right hand turns and the left one holds still: the tear runs toward the right thumb
///   curved      the left hand turns first and most, then the right one: the tear bends one way and the other
///   pulled      the hands turn once, then move apart in one pull
///   steady      the same, slowly and evenly: about 0.15 m/s
///   torn        slow at first, then faster, then one pull: what `rustle demo tear` shows
/// At the end the pieces are drawn apart.
[[nodiscard]] std::span<const std::string_view> tear_script_names();

/// Where both thumbs are, seen from the tip, in the material plane.
[[nodiscard]] std::array<Point2, 2> thumbs_from_tip(const TearPose& pose);

/// A share of the motion by which the hands turn back and grip farther on: the thumbs as far from the tip as given, closer
/// together toward the border, where there is less room. Pure. \pre the sheet is in one piece, 0 ≤ share ≤ 1
[[nodiscard]] HandMotions grip_farther_on(const TearingSheet& sheet, const std::array<Point2, 2>& from_tip_m, double share);

/// A step of a script: what the hands do in the dt_s after time_s to this sheet. Null: no such name.
class TearScript {
 public:
  virtual ~TearScript() = default;
  virtual HandMotions motions(const TearingSheet& sheet, double time_s, double dt_s) = 0;
  virtual double duration_s() const = 0;
};
[[nodiscard]] std::unique_ptr<TearScript> make_tear_script(std::string_view name);

/// The sheet torn by the script, as a stream; it moves in steps of a 240th of a second or less. Null: no such name, or
/// options that TearingSheet::make() refuses.
[[nodiscard]] std::unique_ptr<SheetStream> make_tear(std::string_view script, const TearingOptions& options = {});

}  // namespace rustle::sheets
