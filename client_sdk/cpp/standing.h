#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "rustle/v1/session.pb.h"

/// What a session has said that still holds: what a daemon that starts anew must be told, and what a recording that begins
/// under way holds first. Not for applications.
namespace rustle::client::internal {

inline constexpr std::size_t kReplacedTopologies = 64;   ///< used before and replaced by a newer one; a daemon keeps as many
inline constexpr std::size_t kWaitingTopologies = 1024;  ///< sent and not yet used

/// Sheets, topologies, the scene and the listener as of the newest message taken. Pure; knows no socket.
class Standing {
 public:
  void take(const v1::StreamMessage& message);
  /// In the order in which they are to be sent; neither numbered nor addressed.
  std::vector<v1::StreamMessage> messages() const;

  std::optional<double> newest_time_s() const { return newest_time_s_; }
  bool ended() const { return ended_; }

 private:
  struct KnownTopology {
    v1::Topology topology;
    std::uint64_t last_use;
    bool used = false;
  };

  void take_time(double time_s);
  void use(std::uint32_t sheet_id, std::uint64_t topology_id);
  bool is_current(std::uint64_t topology_id) const;
  void forget_topologies();
  void change(const v1::SceneUpdate& update);

  std::optional<double> newest_time_s_{};
  bool ended_ = false;
  std::map<std::uint32_t, v1::Sheet> sheets_{};
  std::map<std::uint64_t, KnownTopology> topologies_{};
  std::map<std::uint32_t, std::uint64_t> current_{};  ///< topology of each sheet
  std::uint64_t uses_ = 0;
  std::map<std::uint32_t, v1::Obstacle> obstacles_{};
  double scene_time_s_ = 0;
  std::optional<v1::Listener> listener_{};
};

}  // namespace rustle::client::internal
