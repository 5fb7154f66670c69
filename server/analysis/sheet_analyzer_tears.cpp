#include <algorithm>
#include <utility>

#include "server/analysis/sheet_analyzer.h"

namespace rustle::analysis {

std::vector<observation::TearEvent> SheetAnalyzer::tears_of(const sheet::MeshFrame& frame, const sheet::Topology* before,
                                                            const std::optional<Arrival>& arrival,
                                                            std::uint64_t& next_event_id) {
  state_.sends_tips |= !frame.tear_tips.empty();
  if (state_.sends_tips) return sent_tears(frame, next_event_id);
  if (!arrival) return find_tears(frame, nullptr, parameters_, state_.tears, next_event_id);
  const bool whole = std::find(arrival->remade.begin(), arrival->remade.end(), true) == arrival->remade.end();
  const TopologyChange change{before, state_.last->positions_m, state_.carried_m, whole, state_.last->time_s};
  return find_tears(frame, &change, parameters_, state_.tears, next_event_id);
}

std::vector<observation::TearEvent> SheetAnalyzer::sent_tears(const sheet::MeshFrame& frame, std::uint64_t& next_event_id) {
  std::vector<observation::TearEvent> out;
  const double previous_s = state_.last ? state_.last->time_s : frame.time_s;
  for (const sheet::SentTearTip& tip : frame.tear_tips) {
    auto [entry, is_new] = state_.sent_tips.try_emplace(tip.tip_id, SentTip{0, previous_s, 0});
    SentTip& known = entry->second;
    if (is_new) known.id = next_event_id++;
    observation::TearEvent event;
    event.id = known.id;
    event.speed_m_per_s = static_cast<double>(tip.speed_m_per_s);
    known.torn_m += event.speed_m_per_s * (frame.time_s - std::max(previous_s, known.seen_s));
    known.seen_s = frame.time_s;
    event.torn_m = known.torn_m;
    event.position_m = tip.position_m.cast<double>();
    if (tip.direction) event.direction = tip.direction->cast<double>();
    event.source = observation::Source::kSent;
    out.push_back(std::move(event));
  }
  std::erase_if(state_.sent_tips,
                [&](const auto& tip) { return tip.second.seen_s < frame.time_s - parameters_.tear_memory_s; });
  return out;
}

}  // namespace rustle::analysis
