#pragma once

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "server/apps/heads.h"
#include "server/apps/strangers.h"
#include "server/session/clock_drift.h"
#include "server/session/scheduler.h"
#include "server/sinks/playback.h"
#include "server/wire/control.h"
#include "server/wire/decode.h"
#include "server/wire/sockets.h"
#include "server/wire/topics.h"
#include "sound_db/pack/library.h"

namespace rustle::apps {

struct DaemonOptions {
  wire::Sockets::Options sockets;
  int analysis_workers = std::max(1, session::usable_cpus() - 1);
  int render_workers = 1;
  std::vector<int> analysis_cpus, render_cpus;  ///< where they run; empty: anywhere
  std::uint32_t rate_hz = 48000;
  std::uint32_t block_size = 128;
  std::size_t max_sessions = 256;
  std::vector<std::string> hrtfs;  ///< "structural", "kemar" or SOFA files, offered by their stems; the first is the default
  std::optional<sinks::Playback::Options> playback;  ///< live sessions are also played on a device
};

/// The daemon: sockets on one side, sessions on the other. Decodes what arrives and hands it to its session, publishes what
/// sessions have to say. run() is the network thread; everything here belongs to it.
class Daemon {
 public:
  /// Error: a sentence that names the endpoint or flag and what to do.
  static tl::expected<std::unique_ptr<Daemon>, std::string> open(
      DaemonOptions options, std::shared_ptr<pack::PackLibrary> packs,
      std::shared_ptr<const session::WallClock> clock = std::make_shared<session::SteadyClock>());
  ~Daemon();

  const wire::Sockets& sockets() const { return *sockets_; }

  /// Serves until `stop` is set; `between` is called many times a second, on this thread.
  void run(const std::atomic<bool>& stop, const std::function<void()>& between = {});

  /// From now on so many sessions at a time; those there are stay. [network thread]
  void limit_sessions(std::size_t most) { max_sessions_ = most; }

 private:
  using Instant = session::WallClock::Duration;

  /// PCM on its way to one topic.
  struct PcmOut {
    wire::PcmTopic topic;
    std::vector<float> waiting;
    std::int64_t first_sample = 0;
    std::uint64_t sequence = 0;
    std::uint64_t missing = 0;  ///< samples that the socket did not take since the last message
  };
  struct NoticeTally {
    std::optional<Instant> last_sent;
    std::uint64_t unsent = 0;
  };
  /// A detach that waits for its answer.
  struct Goodbye {
    wire::ControlPeer peer;
    std::uint64_t request_id;
    std::uint64_t last_sequence;  ///< the stream ends when this has come
    bool discard;
    Instant since;
  };
  struct Guest {
    Guest(std::shared_ptr<session::Session> its_session, std::string its_name, bool by_control)
        : session(std::move(its_session)), decoder(session->options()), name(std::move(its_name)), attached(by_control) {}

    std::shared_ptr<session::Session> session;
    wire::Decoder decoder;
    std::string name;
    bool attached;  ///< by control; else by an announcement
    bool detached = false;
    std::uint64_t last_sequence = 0, messages = 0, refused = 0;
    std::uint64_t samples_sent = 0, samples_in_gaps = 0;
    std::size_t kept_bytes = 0;  ///< of messages since the last item that became none, such as topologies
    session::ClockDrift drift;
    std::uint64_t offered = 0, analysed = 0, acknowledged = 0;  ///< stream sequences
    std::map<std::uint32_t, double> newest_frame_s;             ///< by sheet
    std::map<std::string, PcmOut> pcm;                          ///< by topic
    std::optional<sinks::PlaybackMix::SourceId> played;
    std::map<std::string, std::uint64_t> out_sequence;  ///< by topic, of what is not PCM
    std::map<std::string, NoticeTally> notices;         ///< by code
    Instant last_heard{}, finished_at{}, credited_at{};
    std::optional<Instant> client_left{};  ///< since nobody listens to its notices any more
    bool finished = false;
    std::vector<Goodbye> goodbyes;
  };

  Daemon(DaemonOptions options, std::shared_ptr<pack::PackLibrary> packs, std::shared_ptr<const session::WallClock> clock);

  void handle(wire::ControlRequestReceived& event);
  void handle(wire::StreamReceived& event);
  void handle(wire::SubscriptionChanged& event);

  wire::ControlReply answer(const wire::ControlRequest& request);
  wire::ControlReply attach(const wire::ControlRequest& request, const wire::AttachRequest& body);
  /// Ends the stream of a guest that leaves, once all it sent has come, and answers when all of it is accounted for.
  void say_goodbye(Guest& leaving);
  wire::ControlReply pack_list() const;
  /// Logs what belongs to no session, a line a second at most.
  void complain(std::string_view what, const wire::Error& error);
  void tell_of_sockets();
  std::optional<wire::Error> check_material(const std::string& material, const std::string& surface,
                                            std::string field) const;

  wire::Error too_many_sessions() const;

  Guest& admit(const std::string& id, std::string name, session::SessionOptions options,
               const std::shared_ptr<const spatial::Hrtf>& head, bool attached);
  Guest* guest(const std::string& id);
  /// The publisher as a guest once enough is known of it; until then the message may be kept. Null: not yet.
  Guest* meet_publisher(wire::StreamEnvelope& envelope);
  void take(Guest& guest, const wire::StreamEnvelope& envelope);
  void serve(const std::string& id, Guest& guest);
  void play(Guest& guest, const session::AudioBlock& block);
  void publish_pcm(Guest& guest, const session::AudioBlock& block);
  void flush_pcm(Guest& guest, PcmOut& out, bool all);
  void notify(Guest& guest, const wire::Error& error);
  void publish_notice(const std::string& session_id, const wire::Notice& notice, std::uint64_t sequence);
  void publish_end(Guest& guest);
  void acknowledge(Guest& guest);
  void let_go();
  void end_idle(Guest& idle, std::chrono::seconds after);
  wire::Statistics statistics(const Guest& guest) const;

  const DaemonOptions options_;
  std::size_t max_sessions_;
  const std::shared_ptr<pack::PackLibrary> packs_;
  Heads heads_;
  std::map<std::filesystem::path, std::shared_ptr<const pack::SoundPack>> held_packs_;  ///< at the daemon's rate
  const std::shared_ptr<const session::WallClock> clock_;
  std::unique_ptr<wire::Sockets> sockets_;
  std::map<std::string, std::unique_ptr<Guest>> guests_;
  Strangers strangers_;
  std::unique_ptr<session::Scheduler> scheduler_;
  std::unique_ptr<sinks::Playback> playback_;
  session::AudioBlock block_;
  NoticeTally complaints_;
  wire::Sockets::Counters told_;
  std::uint64_t next_name_ = 1;
};

}  // namespace rustle::apps
