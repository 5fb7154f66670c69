#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "client_sdk/cpp/session.h"
#include "client_sdk/sheets/loops.h"

namespace rustle::apps {

/// What a synthetic client sends.
struct LoadPlan {
  std::shared_ptr<const sheets::Loop> loop;
  std::size_t phase = 0;  ///< the loop's frame to begin with
  double frames_per_s = 60;
  double jitter_s = 0;         ///< a frame is sent up to so much after it is due, evenly spread
  double withheld = 0;         ///< share of frames that are never sent
  double playout_delay_s = 0;  ///< of its session; 0: the daemon's choice
  int blocks = 4;              ///< in a PCM message
  std::string material;
  std::uint64_t seed = 0;
};

/// A synthetic simulator with its listener: a live session of its own over sockets of its own, one sheet that sounds all the
/// time. Two threads meet here; each method says whose it is.
class LoadClient {
 public:
  using Time = std::chrono::steady_clock::time_point;

  /// What it saw.
  struct Figures {
    std::uint64_t frames_sent = 0;
    std::vector<float> latency_s;  ///< of each frame: from frame() to the message in which its moment sounds
    std::vector<float> late_s;     ///< of each frame: how much later than planned it was sent, a fault of this machine
    std::uint64_t pcm_gaps = 0;    ///< that its listener met
    double longest_silence_s = 0;  ///< of its sound, from its first on
  };

  /// Attaches and sends a first frame, which has the daemon prepare for the mesh; others are due once it has begun.
  /// [control]
  [[nodiscard]] static tl::expected<std::unique_ptr<LoadClient>, client::Error> attach(const client::Connection& connection,
                                                                                       const std::string& name,
                                                                                       LoadPlan plan);
  /// Frames are due from this moment on. [control]
  void begin(Time first);

  // ---- [sender]

  Time due() const { return send_at_; }
  /// Sends the frame that is due. `speed`: frames come so many times as often as planned, and the motion is as much faster.
  [[nodiscard]] tl::expected<void, client::Error> send(double speed);

  // ---- [listener]

  /// Takes what has come. False: nothing had.
  bool listen();

  // ---- [control], while neither sends nor listens

  const std::string& id() const { return session_.id(); }
  /// Latencies and lateness from now on; what came before was warming up.
  void begin_measuring();
  Figures take_figures();
  /// Ends the session; its last figures.
  [[nodiscard]] tl::expected<client::Statistics, client::Error> detach() { return session_.detach(true); }
  /// Is gone, as if its machine had failed.
  void vanish() { session_.abandon(); }

 private:
  struct UnderWay {
    double time_s;
    Time sent;
  };

  LoadClient(client::Session session, client::PcmReader reader, LoadPlan plan);
  void plan_next(double speed);
  /// The mesh of the loop's frame, where it is not the newest sent.
  [[nodiscard]] tl::expected<void, client::Error> send_mesh(std::size_t mesh);

  client::Session session_;
  client::PcmReader reader_;
  const LoadPlan plan_;
  Time start_;  ///< of simulation time 0

  std::mt19937_64 random_;
  std::size_t frame_ = 0;            // sender: of the loop
  double time_s_ = 0;                // sender: simulation time of the frame that is due
  std::optional<std::size_t> mesh_;  // sender: the loop's mesh sent last
  bool fresh_ = false;               // sender: another sheet than that of the frame sent last
  std::uint64_t topologies_ = 0;     // sender: sent so far, numbered from 1
  Time planned_, send_at_;
  Figures sent_;  // sender: its part

  std::mutex mutex_;
  std::deque<UnderWay> under_way_;  ///< sent, not heard

  Figures heard_;  // listener: its part
  double silent_s_ = 0;
  bool sounded_ = false;
};

/// The moment `seconds` after `time`.
inline LoadClient::Time later(LoadClient::Time time, double seconds) {
  return time + std::chrono::duration_cast<LoadClient::Time::duration>(std::chrono::duration<double>(seconds));
}

}  // namespace rustle::apps
