#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "client_sdk/cpp/connection.h"
#include "client_sdk/cpp/types.h"

namespace rustle::client {

namespace internal {
class Subscription;
}

struct ObservedResonator {
  bool constrained = true;
  bool coarse = false;              ///< the mesh is too coarse there for the promised accuracy
  double ruling_length_m = 0;       ///< l_r
  double free_border_length_m = 0;  ///< l_c
  double area_m2 = 0;
};

struct ObservedCrumpling {
  std::uint64_t event_id = 0;
  std::uint64_t continues_event_id = 0;  ///< 0: none
  double time_s = 0;                     ///< when the curvature passed zero
  double amplitude_m = 0;
  double area_m2 = 0;
  Vector3 position{};
  std::vector<ObservedResonator> resonators;
};

struct ObservedFriction {
  std::uint64_t event_id = 0;  ///< stays for the whole episode
  double speed_m_per_s = 0;
  double area_m2 = 0;
  Vector3 position{};
  std::string touched_surface;
  std::vector<ObservedResonator> resonators;
};

/// What the daemon saw in one frame. Metres, the session's axes.
struct Observation {
  std::uint32_t sheet_id = 0;
  double time_s = 0;
  std::vector<ObservedCrumpling> crumpling;
  std::vector<ObservedFriction> friction;
};

/// A session's observations as they come; frames in which nothing happened are not told. One thread at a time, which does
/// all its work; may be another one than the session's.
class ObservationReader {
 public:
  /// Returns when the daemon has seen the subscription: nothing that is sent to the session afterwards is missed.
  /// `reconnect`: a daemon that has gone is waited for, instead of being an error of check().
  /// Errors: "timeout", "unreachable".
  [[nodiscard]] static tl::expected<ObservationReader, Error> listen(const Connection& connection,
                                                                     const std::string& session_id, bool reconnect = false);

  ObservationReader(ObservationReader&&) noexcept;
  ObservationReader& operator=(ObservationReader&&) noexcept;
  ~ObservationReader();

  /// The next observation; empty when none came in time, or sooner where check() has an error.
  [[nodiscard]] std::optional<Observation> next(std::chrono::milliseconds timeout);
  /// At once. Error: "unreachable": the daemon has gone, and is not waited for.
  [[nodiscard]] tl::expected<void, Error> check() const;
  /// Whether what the daemon publishes arrives here now. Any thread.
  bool is_heard() const;

 private:
  friend class Session;
  struct Impl;
  explicit ObservationReader(std::unique_ptr<Impl> impl);
  std::weak_ptr<internal::Subscription> subscription() const;
  std::unique_ptr<Impl> impl_;
};

}  // namespace rustle::client
