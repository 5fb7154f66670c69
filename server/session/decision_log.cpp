#include "server/session/decision_log.h"

#include <cassert>

namespace rustle::session {

void DecisionLog::accepted(synthesis::SampleTime at) {
  assert(!under_way_.empty());
  UnderWay oldest = std::move(under_way_.front());
  under_way_.pop_front();
  oldest.step.accepted_at = at;
  if (oldest.mapping) tell(*oldest.mapping);
  tell(std::move(oldest.step));
}

void DecisionLog::rendered(synthesis::SampleTime sample) {
  if (rendered_wanted_.exchange(false)) tell(RenderedTo{sample});
}

void DecisionLog::dropped(std::uint64_t arrival, std::uint64_t sequence, const std::string& cause) {
  tell(Dropped{arrival, sequence, cause});
}

std::vector<Decision> DecisionLog::take() {
  std::lock_guard lock(mutex_);
  return std::exchange(told_, {});
}

void DecisionLog::tell(Decision decision) {
  if (!kept()) return;
  std::lock_guard lock(mutex_);
  told_.push_back(std::move(decision));
}

}  // namespace rustle::session
