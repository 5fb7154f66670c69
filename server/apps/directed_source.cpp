#include "server/apps/directed_source.h"

#include <algorithm>
#include <utility>

namespace rustle::apps {

std::optional<session::DirectedItem> DirectedSource::next() {
  while (auto record = source_.next_record()) {
    std::optional<session::DirectedItem> directed;
    if (auto* arrived = std::get_if<CaptureSource::Arrived>(&*record)) {
      directed = held_at_the_beginning(*arrived);
    } else {
      directed = decided(std::get<session::Decision>(*record));
    }
    if (directed) return directed;
  }
  return std::nullopt;
}

std::optional<session::DirectedItem> DirectedSource::held_at_the_beginning(CaptureSource::Arrived& arrived) {
  if (!arrived.item) return std::nullopt;
  if (arrived.arrival != 0) {
    undecided_.insert_or_assign(arrived.arrival, std::move(*arrived.item));
    return std::nullopt;
  }
  session::DirectedItem directed;
  directed.what = std::move(*arrived.item);
  directed.mapping = std::exchange(mapping_, std::nullopt);
  if (source_.options().clock == session::Clock::kLive) directed.earliest = 0;
  return directed;
}

std::optional<session::DirectedItem> DirectedSource::decided(const session::Decision& decision) {
  if (const auto* mapping = std::get_if<engine::TimeMapping>(&decision)) {
    mapping_ = *mapping;
    mapping_->first_sample -= first_sample_;
  } else if (const auto* dropped = std::get_if<session::Dropped>(&decision)) {
    const auto item = undecided_.extract(dropped->arrival);
    if (item && std::holds_alternative<sheet::MeshFrame>(item.mapped())) ++frames_dropped_[dropped->cause];
  } else if (const auto* rendered = std::get_if<session::RenderedTo>(&decision)) {
    return session::DirectedItem{*rendered, std::nullopt, std::nullopt, from_first(rendered->sample), false};
  } else if (const auto* step = std::get_if<session::Step>(&decision)) {
    return taken_again(*step);
  }
  return std::nullopt;
}

session::DirectedItem DirectedSource::taken_again(const session::Step& step) {
  session::DirectedItem directed;
  directed.accepted_at = from_first(step.accepted_at);
  directed.what = std::visit([&](const auto& what) { return what_of(what, directed.accepted_at); }, step.what);
  directed.mapping = std::exchange(mapping_, std::nullopt);
  if (step.earliest) directed.earliest = from_first(*step.earliest);
  directed.start_again = step.start_again;
  return directed;
}

DirectedSource::What DirectedSource::what_of(const session::Given& given, synthesis::SampleTime accepted_at) {
  auto item = undecided_.extract(given.arrival);
  if (!item) return session::RenderedTo{accepted_at};
  return std::move(item.mapped());
}

DirectedSource::What DirectedSource::what_of(const session::Failed& failed, synthesis::SampleTime accepted_at) {
  undecided_.erase(failed.arrival);
  return session::RenderedTo{accepted_at};
}

synthesis::SampleTime DirectedSource::from_first(synthesis::SampleTime sample) const {
  return std::max<synthesis::SampleTime>(0, sample - first_sample_);
}

}  // namespace rustle::apps
