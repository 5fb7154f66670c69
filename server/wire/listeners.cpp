#include "server/wire/listeners.h"

#include <iterator>
#include <utility>

namespace rustle::wire {
namespace {

constexpr std::size_t kMostRefusalsTold = 16;

}  // namespace

bool Listeners::grant(const std::string& topic, const PeerConnection& connection, const std::string& user) {
  auto& heard_by = topics_[topic];
  heard_by.insert_or_assign(connection, user);
  return heard_by.size() == 1;
}

bool Listeners::leave(const std::string& topic, const PeerConnection& connection) {
  const auto entry = topics_.find(topic);
  if (entry == topics_.end()) return false;
  entry->second.erase(connection);
  if (!entry->second.empty()) return false;
  topics_.erase(entry);
  return true;
}

void Listeners::end(const std::string& topic) {
  if (topics_.contains(topic)) unsettled_[topic] = Clock::now() + kLook;
}

std::vector<std::string> Listeners::settle(Clock::time_point now) {
  std::vector<std::string> silent;
  for (auto looked_at = unsettled_.begin(); looked_at != unsettled_.end();) {
    const auto entry = topics_.find(looked_at->first);
    if (entry != topics_.end()) {
      std::erase_if(entry->second, [](const auto& heard) { return !is_open(heard.first); });
      if (entry->second.empty()) {
        silent.push_back(entry->first);
        topics_.erase(entry);
      }
    }
    const bool done = now >= looked_at->second || !topics_.contains(looked_at->first);
    looked_at = done ? unsettled_.erase(looked_at) : std::next(looked_at);
  }
  return silent;
}

void Listeners::refuse(const std::string& topic, const PeerConnection& connection) {
  std::erase_if(refusals_, [&](const auto& entry) { return entry.first != connection && !is_open(entry.first); });
  auto& told = refusals_[connection];
  if (told.size() < kMostRefusalsTold) told.push_back(topic);
}

std::vector<std::string> Listeners::take_refusals(const PeerConnection& connection) {
  auto taken = refusals_.extract(connection);
  return taken.empty() ? std::vector<std::string>() : std::move(taken.mapped());
}

void Listeners::cut_unless(const std::function<bool(const std::string& user, const std::string& topic)>& may_stay) const {
  for (const auto& [topic, heard_by] : topics_)
    for (const auto& [connection, user] : heard_by)
      if (!may_stay(user, topic)) cut(connection);
}

}  // namespace rustle::wire
