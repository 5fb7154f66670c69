#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "client_sdk/sheets/animated_sheet.h"
#include "server/session/session.h"

namespace rustle::realtime {

/// A clock turned by hand. What is put into `inside` is done once, by whoever next asks for the time: in a live session that
/// is the render worker, in the midst of its work.
class TurnedClock final : public session::WallClock {
 public:
  Duration now() const override {
    if (inside) std::exchange(inside, nullptr)();
    return now_;
  }
  void turn_to(double time_s) { now_ = Duration(static_cast<std::int64_t>(time_s * 1e9)); }

  mutable void (*inside)() = nullptr;

 private:
  Duration now_{};
};

/// What a session is and is sent, without end: its sheets move to and fro.
struct Scenario {
  std::string name;
  session::SessionOptions options;
  std::vector<std::shared_ptr<const sheets::AnimatedSheet>> sheets;
  bool walls = false;   ///< one that stands and one that moves, and a listener who walks about
  bool pauses = false;  ///< live: no frame comes for the last 0.6 s of every 3 s
};

/// Sheets from crumpling to sliding, both clocks, every layout and mode.
std::vector<Scenario> all_scenarios();

/// A session and its simulator. feed and drain are the work of analysis and network threads, render that of the render
/// worker.
class Stream {
 public:
  Stream(const Scenario& scenario, std::shared_ptr<pack::PackLibrary> packs, const TurnedClock& clock);

  const std::string& name() const { return scenario_.name; }
  bool live() const { return scenario_.options.clock == session::Clock::kLive; }

  /// Sends and analyses what is due until `time_s`.
  void feed(double time_s);
  void render() { wants_analysis_ = session_.render().wants_analysis; }
  /// Takes the sound and what analysis tells.
  void drain();

  std::int64_t samples() const { return session_.samples_rendered(); }
  session::Counters counters() const { return session_.counters(); }
  double loudest() const { return loudest_; }

 private:
  void offer(engine::StreamItem item);
  void analyse();
  void move_surroundings(double time_s);

  const Scenario scenario_;
  std::vector<std::vector<sheet::MeshFrame>> frames_;  ///< [sheet][k], once there
  session::Session session_;
  session::AudioBlock block_;
  std::int64_t next_frame_ = 0;
  bool wants_analysis_ = false;
  double loudest_ = 0;
};

}  // namespace rustle::realtime
