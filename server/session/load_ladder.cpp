#include "server/session/load_ladder.h"

#include "server/engine/economy.h"

namespace rustle::session {

std::optional<std::uint32_t> LoadLadder::look(WallClock::Duration now, const LoadSigns& signs) {
  if (signs.suffers || signs.busy >= kBusy) {
    well_since_.reset();
    if (++bad_looks_ < 2 || level_ == engine::kMostLoadLevel) return std::nullopt;
    bad_looks_ = 0;
    return ++level_;
  }
  bad_looks_ = 0;
  if (signs.busy > kLeisure || level_ == 0) {
    well_since_.reset();
    return std::nullopt;
  }
  if (!well_since_) well_since_ = now;
  if (now - *well_since_ < kWell) return std::nullopt;
  well_since_ = now;
  return --level_;
}

}  // namespace rustle::session
