#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client_sdk/sheets/animated_sheet.h"
#include "server/engine/options.h"
#include "server/engine/stream_item.h"
#include "server/observation/observation.h"
#include "server/scene/scene.h"
#include "server/session/offline.h"
#include "server/validation/check.h"

/// Sheets that exist on the computer only, through the whole pipeline: analysis, observation, planner, mixer.
namespace rustle::validation {

/// The listener of the paper's recordings: 1 m from the origin, 30 degrees above the table, on the -y side.
sheet::Vec3d listening_point_m();

/// Solid below z = 0.
scene::Obstacle table(bool reflecting = true);
/// Reflects what is on the side of `normal`.
scene::Obstacle wall(const sheet::Vec3d& point_m, const sheet::Vec3d& normal);

struct Take {
  const sheets::AnimatedSheet* sheet = nullptr;
  std::vector<scene::Obstacle> obstacles;
  sheet::Vec3d listener_m = listening_point_m();
  double frame_rate_hz = 60;
  engine::Mode mode = engine::Mode::kCorrected;
  std::uint64_t seed = 1;
  std::string material = {};  ///< empty: the setting's
};

struct Heard {
  std::vector<float> samples;  ///< mono at kRate_hz
  std::vector<observation::Observation> observed;
  session::OfflineSummary summary;

  std::vector<observation::CrumplingEvent> crumpling() const;
  /// The samples of [from_s, to_s), zero where there are none.
  std::vector<float> between(double from_s, double to_s) const;
};

/// The animation from 0 to its end, with what is around it, as a simulator would send it.
std::vector<engine::StreamItem> stream_of(const Take& take);

/// Renders the animation from 0 to its end, as `rustle render` would. Throws std::runtime_error when an item is refused.
Heard play(const Setting& setting, const Take& take);

/// A bent rectangle that stands on its two straight edges (flat: lies) on the table and is slid to and fro along its bend
/// over 20 cm at 0.1 m/s, as the paper's were (section 5).
struct RubbedSheet {
  double bent_edge_m = 0.10;      ///< along x, l_c/2
  double straight_edge_m = 0.10;  ///< along y, l_r
  double compression = 0.30;      ///< 0: flat
  std::size_t triangles = 1000;
};
std::unique_ptr<sheets::AnimatedSheet> make_rubbed(const RubbedSheet& sheet, double duration_s);

/// Trapezoids with bases of 4 and 16 cm, 10 cm high, compressed by 30 %, slid in the same way (Fig. 11 d). Their mean normal
/// leans toward one base; the bases lie along y, so that the listener sees it neither lean toward him nor away.
enum class Trapezoid {
  kCurvedBases,   ///< S2: a cone on its two straight legs; the bases are the free borders
  kStraightBases  ///< S3: a cylinder on its two bases; the legs are the free borders
};
std::unique_ptr<sheets::AnimatedSheet> make_rubbed(Trapezoid shape, double duration_s, std::size_t triangles = 1000);

/// A bent rectangle centred at `centre_m`, its normal +z when flat turned by `tilt_rad` about y, whose whole bend is
/// reversed `reversals` times: the first zero of curvature at 0.3 s, the next every `interval_s`.
struct FlappedSheet {
  double bent_edge_m = 0.10, straight_edge_m = 0.10;
  double compression = 0.10;
  std::size_t triangles = 600;
  sheets::Point3 centre_m = {0, 0, 0};
  double tilt_rad = 0;
  double reversal_s = 0.03;  ///< from one full bend to the other
  int reversals = 1;
  double interval_s = 1.2;

  double zero_s(int reversal) const { return 0.3 + interval_s * reversal; }
};
std::unique_ptr<sheets::AnimatedSheet> make_flapped(const FlappedSheet& sheet);

/// An A4 sheet in the air that is crumpled harder and harder: creases in seven directions that fold to and fro, for the
/// load that this is, not for its sound.
std::unique_ptr<sheets::AnimatedSheet> make_crumpled(std::size_t triangles, double duration_s);

}  // namespace rustle::validation
