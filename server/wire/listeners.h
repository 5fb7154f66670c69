#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "server/wire/peer_connection.h"

namespace rustle::wire {

/// Whose subscriptions are in force. ZeroMQ tells of a subscription with the connection it came by, but of a connection that
/// ended only that somebody's subscription to a topic has gone, perhaps one that was never granted: whose it was is found by
/// looking which connection is open no more. One thread at a time.
class Listeners {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr std::size_t kMostTopics = 65'536;  ///< beyond, subscriptions are refused
  static constexpr std::chrono::seconds kLook{5};     ///< a connection that ended is closed by then

  /// Whether there is room for this topic.
  bool takes(const std::string& topic) const { return topics_.contains(topic) || topics_.size() < kMostTopics; }
  /// True: now it is heard, and was not. \pre takes(topic)
  bool grant(const std::string& topic, const PeerConnection& connection, const std::string& user);
  /// The connection is there, and unsubscribed. True: now the topic is not heard, and was.
  bool leave(const std::string& topic, const PeerConnection& connection);
  /// Some connection that had subscribed, or had been refused, has ended or soon will have.
  void end(const std::string& topic);
  /// Looks who has gone of the topics that end() named. Returns those that are heard no more.
  std::vector<std::string> settle(Clock::time_point now);

  /// A subscription that was not granted, to be told to its connection.
  void refuse(const std::string& topic, const PeerConnection& connection);
  /// What this connection was refused since it was asked last.
  std::vector<std::string> take_refusals(const PeerConnection& connection);

  /// Cuts the connections of all whose granted subscription `may_stay` denies.
  void cut_unless(const std::function<bool(const std::string& user, const std::string& topic)>& may_stay) const;

 private:
  std::map<std::string, std::map<PeerConnection, std::string>> topics_;  ///< who hears them, with the user
  std::map<std::string, Clock::time_point> unsettled_;                   ///< until when they are looked at
  std::map<PeerConnection, std::vector<std::string>> refusals_;
};

}  // namespace rustle::wire
