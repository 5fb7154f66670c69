#include <fmt/format.h>

#include <cmath>

#include "server/validation/groups.h"
#include "server/validation/measures.h"
#include "server/validation/virtual_sheet.h"
#include "sound_db/dsp/level.h"
#include "sound_db/pack/bent_strip.h"
#include "sound_db/pack/levels.h"

namespace rustle::validation {
namespace {

constexpr double kMargin_db = 0.5;
constexpr int kReversals = 12;
constexpr double kSliding_s = 10, kLead_s = 0.5;

}  // namespace

Findings levels(const Setting& setting) {
  double flap_db = 0, amplitude_m = 0, slide_db = 0;
  run_all(setting, 2, [&](std::size_t k) {
    Take take;
    take.seed = setting.seed;
    if (k == 0) {
      FlappedSheet flap;
      flap.reversals = kReversals;
      const auto sheet = make_flapped(flap);
      take.sheet = sheet.get();
      take.listener_m = {0, 0, 1};
      take.frame_rate_hz = 120;
      const Heard heard = play(setting, take);
      for (int r = 0; r < kReversals; ++r) {
        flap_db += dsp::peak_dbfs(heard.between(flap.zero_s(r) - 0.1, flap.zero_s(r) + 1.0)) / kReversals;
      }
      std::vector<double> joined;  // what continues an event adds to it
      for (const auto& event : heard.crumpling()) {
        if (event.continues == 0 || joined.empty()) joined.push_back(0);
        joined.back() += event.amplitude_m;
      }
      for (const double a : joined) amplitude_m += a / kReversals;
    } else {
      const auto sheet = make_rubbed(RubbedSheet{}, kSliding_s + 2 * kLead_s);
      take.sheet = sheet.get();
      take.obstacles = {table(false)};
      // 1 m above the middle of the sheet's height.
      take.listener_m = {0, 0, 1 + pack::bent_strip(0.10, 0.30).mean_height_m};
      slide_db = dsp::rms_dbfs(play(setting, take).between(kLead_s, kLead_s + kSliding_s));
    }
  });
  Findings found;
  found.checks.push_back({"levels/flap_peak", flap_db, std::nullopt,
                          around(pack::kReferenceFlapPeak_dbfs, kMargin_db, "dBFS"), "dBFS",
                          "mean peak of the 10 x 10 cm sheet whose whole bend (10 %) is reversed, at 1 m on the axis"});
  found.checks.push_back({"levels/flap_amplitude", amplitude_m, std::nullopt, around(0.16, 0.02, "m"), "m",
                          "amplitude that the analysis gives this event"});
  found.checks.push_back({"levels/sliding", slide_db, std::nullopt,
                          around(pack::kReferenceFriction_dbfs, kMargin_db, "dBFS"), "dBFS",
                          "RMS over 10 s of the 10 x 10 cm sheet bent by 30 % slid at 0.1 m/s, at 1 m on the axis"});
  return found;
}

}  // namespace rustle::validation
