#pragma once

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "client_sdk/cpp/standing.h"
#include "server/access/gate.h"
#include "server/apps/heads.h"
#include "server/apps/pack_reloads.h"
#include "server/apps/pcm_output.h"
#include "server/apps/recorder.h"
#include "server/apps/strangers.h"
#include "server/monitor/figures.h"
#include "server/page/figures.h"
#include "server/session/allowance.h"
#include "server/session/clock_drift.h"
#include "server/session/load_ladder.h"
#include "server/session/scheduler.h"
#include "server/sinks/playback.h"
#include "server/wire/control.h"
#include "server/wire/decode.h"
#include "server/wire/sockets.h"
#include "server/wire/topics.h"
#include "sound_db/pack/library.h"

namespace rustle::page {
class Host;
class Page;
}  // namespace rustle::page

namespace rustle::apps {

/// What a live session may use while others are there.
struct SessionBudget {
  double analysis_s_per_s = 0.5;
  double megabytes_per_s = 64;  ///< as received
};

struct DaemonOptions {
  wire::Sockets::Options sockets;
  std::vector<std::string> connect;    ///< publishers' endpoints; with a gate ENDPOINT#NAME, the name of their key
  std::shared_ptr<access::Gate> gate;  ///< who may use it; null: everybody who reaches it may do everything
  int analysis_workers = std::max(1, session::usable_cpus() - 1);
  int render_workers = 1;
  std::vector<int> analysis_cpus, render_cpus;  ///< where they run; empty: anywhere
  std::uint32_t rate_hz = 48000;
  std::uint32_t block_size = 128;
  std::size_t max_sessions = 256;
  SessionBudget budget;
  std::vector<std::string> hrtfs;  ///< "structural", "kemar" or SOFA files, offered by their stems; the first is the default
  std::optional<sinks::Playback::Options> playback;  ///< live sessions are also played on a device
  std::string recordings;                            ///< folder of recordings; empty: nothing is recorded
  bool record_all = false;                           ///< every session, whether it asks or not
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

  /// Serves until `stop` is set, then ends all sessions: what they were sent is analysed, rendered and sent, which takes
  /// kDrain at most. `between` is called many times a second, on this thread.
  void run(const std::atomic<bool>& stop, const std::function<void()>& between = {});
  static constexpr std::chrono::seconds kDrain{4};

  /// From now on the page shows what is here, and asks by the host. Both outlive the daemon's run(). [network thread]
  void show_on(page::Page& page, page::Host& host);

  /// Ends the waiting of run(), so that it calls `between`. [any thread]
  void wake() { sockets_->wake(); }
  /// What this daemon tells of itself. [network thread]
  monitor::DaemonFigures figures() const;
  /// Absent: there is no such session. [network thread]
  std::optional<monitor::SessionTraces> traces(const std::string& session_id) const;

  /// Sessions that are there, and that there may be. [network thread]
  std::size_t sessions() const { return guests_.size(); }
  std::size_t most_sessions() const { return max_sessions_; }

  /// Where clients are sent to, in place of the endpoints that are bound; absent: those.
  struct Advertised {
    std::optional<std::string> stream, out;
  };
  /// From now on whoever says hello is told these. [network thread]
  void advertise(Advertised endpoints) { advertised_ = std::move(endpoints); }

  /// From now on so many sessions at a time; those there are stay. [network thread]
  void limit_sessions(std::size_t most) { max_sessions_ = most; }

  /// Reads the keys again: sessions of keys that may not publish any more end, and connections that may not be any more are
  /// cut. Error: a sentence with the remedy; all stays as it was. [network thread]
  [[nodiscard]] tl::expected<void, std::string> reload_keys();

 private:
  friend class DaemonPage;
  using Instant = session::WallClock::Duration;

  // what a client that follows simulation time may have under way
  static constexpr std::uint32_t kWindowMessages = 64;
  static constexpr std::uint64_t kWindowBytes = std::uint64_t{64} << 20;

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
    Guest(std::shared_ptr<session::Session> its_session, std::string its_name, bool by_control, const SessionBudget& budget,
          wire::Sockets& sockets, int most_blocks)
        : session(std::move(its_session)),
          decoder(session->options()),
          name(std::move(its_name)),
          attached(by_control),
          analysis(budget.analysis_s_per_s),
          bytes(1e6 * budget.megabytes_per_s),
          pcm(*session, sockets, most_blocks) {}

    std::shared_ptr<session::Session> session;
    wire::Decoder decoder;
    std::string name;
    std::string owner;  ///< the user that it belongs to; empty without keys
    bool attached;      ///< by control; else by an announcement
    bool detached = false;
    session::Allowance analysis, bytes;
    double analysis_spent_s = 0;   ///< as far as it is paid for
    std::uint64_t suffered = 0;    ///< frames and blocks that came to harm for want of time, as last looked at
    std::uint32_t load_level = 0;  ///< that the session was given
    std::uint64_t last_sequence = 0, messages = 0, refused = 0;
    std::uint64_t arrivals = 0;  ///< by which decisions name messages; sheets of the attach count too
    std::optional<client::internal::Standing> standing;  ///< where it may be recorded from under way
    std::size_t kept_bytes = 0;  ///< of messages since the last item that became none, such as topologies
    session::ClockDrift drift;
    std::uint64_t offered = 0, analysed = 0, acknowledged = 0;  ///< stream sequences
    std::map<std::uint32_t, double> newest_frame_s;             ///< by sheet
    PcmOutput pcm;
    std::optional<sinks::PlaybackMix::SourceId> played;
    std::map<std::string, std::uint64_t> out_sequence;  ///< by topic, of what is not PCM
    std::map<std::string, NoticeTally> notices;         ///< by code
    std::vector<wire::Gain> gains;                      ///< in force
    std::optional<engine::ListenerMove> listener;       ///< as moved since the stream last placed it
    page::Level level;                                  ///< since the page was told; only while somebody looks
    Instant last_heard{}, finished_at{}, credited_at{};
    std::optional<Instant> client_left{};  ///< since nobody listens to its notices any more
    bool finished = false;
    bool stirred = true;  ///< something came for it since it was served
    std::vector<Goodbye> goodbyes;
  };

  Daemon(DaemonOptions options, std::shared_ptr<pack::PackLibrary> packs, std::shared_ptr<const session::WallClock> clock);

  void handle(wire::ControlRequestReceived& event);
  void handle(wire::StreamReceived& event);
  void handle(wire::SubscriptionChanged& event);

  wire::ControlReply answer(const wire::ControlRequest& request, const std::string& user);
  /// The same; where memory runs out, the client is told so.
  wire::ControlReply answer_if_it_fits(const wire::ControlRequest& request, const std::string& user);
  wire::ControlReply attach(const wire::ControlRequest& request, const wire::AttachRequest& body, const std::string& user);
  /// The sheets that an attaching client named, and where its recording goes. Nothing of the session stays where one of them
  /// is refused.
  wire::ControlReply furnish(const std::string& id, const wire::AttachRequest& body, Recorder::NewFile file);
  void dismiss(const std::string& id);
  /// Ends the stream of a guest that leaves, once all it sent has come, and answers when all of it is accounted for.
  void say_goodbye(Guest& leaving);
  wire::ControlReply set_gains(Guest& asked, const wire::SetGainsRequest& request);
  wire::ControlReply change_pack(Guest& asked, const wire::ChangePackRequest& request);
  /// Answers who asked for packs to be read anew, and has sessions take them.
  void finish_reloads();
  wire::PackInfo info_of(const pack::PackEntry& entry) const;
  wire::PackList pack_list() const;
  /// Gives the session an item that came by control; an error where it takes none.
  std::optional<wire::Error> hand_over(Guest& asked, engine::StreamItem item);
  /// That the session has this sheet.
  static std::optional<wire::Error> check_sheet(const Guest& asked, sheet::SheetId sheet, std::string field);
  /// Logs what belongs to no session, a line a second at most.
  void complain(std::string_view what, const wire::Error& error);
  void tell_of_sockets();
  std::optional<wire::Error> check_material(const std::string& material, const std::string& surface,
                                            std::string field) const;

  wire::Error too_many_sessions() const;

  Guest& admit(const std::string& id, std::string name, session::SessionOptions options,
               const std::shared_ptr<const spatial::Hrtf>& head, bool attached, const std::string& owner);
  Guest* guest(const std::string& id);
  /// The publisher as a guest once enough is known of it; until then the message may be kept. Null: not yet.
  Guest* meet_publisher(wire::StreamEnvelope& envelope, const std::string& user);
  void take(Guest& guest, const wire::StreamEnvelope& envelope, std::span<const std::byte> bytes);
  /// Those that something came for or that have news; all of them now and then.
  void serve_guests();
  void serve(const std::string& id, Guest& guest);
  void play(Guest& guest, const session::AudioBlock& block);
  void notify(Guest& guest, const wire::Error& error);
  void publish_notice(const std::string& session_id, const wire::Notice& notice, std::uint64_t sequence);
  void acknowledge(Guest& guest);
  void let_go();
  void end_idle(Guest& idle, std::chrono::seconds after);
  /// What was not rendered yet is dropped.
  void end_at_once(Guest& ended);
  wire::Statistics statistics(const Guest& guest) const;
  monitor::SessionFigures figures_of(const Guest& guest) const;
  /// Its figures stay in the sums. The guest is to be erased.
  void see_off(Guest& leaving);
  /// Sound up to this block's end has left, except what waits for a message to be full.
  static void note_left(Guest& sender, const session::AudioBlock& block);
  void drain(const std::function<void()>& between);
  /// So that its client may go elsewhere at once.
  void tell_of_end(const std::string& id, Guest& told);
  static wire::Error ending();
  wire::ServerStatistics server_statistics() const;

  // ---- daemon_access.cpp

  std::optional<access::AllowedKey> key_of(const std::string& user) const;
  /// The user's name for logs.
  std::string name_of(const std::string& user) const;
  /// Why the user may not ask for this. Nothing: it may.
  std::optional<wire::Error> check_permission(const wire::ControlRequest& request, const std::string& user) const;
  /// Why the user may not send what bears this session id. Nothing: it may.
  std::optional<wire::Error> check_sender(const std::string& session_id, const std::string& user) const;
  bool may_hear(const std::string& user, std::string_view topic) const;
  bool may_see(const std::string& user, const Guest& guest) const;
  std::optional<wire::Error> check_session_quota(const std::string& user) const;
  /// Lowers what the options ask for to what the user's key may have.
  void apply_quotas(session::SessionOptions& options, const std::string& user) const;
  /// Whether the message is within what its sender's key may use; if not, its client is told. Simulations have no frame
  /// dropped for their rate: they are given credit when they may go on.
  bool within_quotas(Guest& sender, const wire::StreamEnvelope& envelope, std::size_t bytes);
  bool rate_left(const Guest& sender);

  // ---- daemon_load.cpp

  /// Whether a frame that came in so many bytes may be analysed; if not, its client is told.
  bool within_budget(Guest& sender, std::size_t bytes);
  /// Looks at how the daemon fares, a few times a second, and has live sessions go to the load level that follows.
  void watch_load();
  session::LoadSigns load_signs(Instant since_last_look);
  void apply_load_level(Guest& guest);
  wire::Error overloaded() const;

  // ---- daemon_recording.cpp

  /// The file of a session that is recorded from its start. Error: there is no recording folder, or the disk refuses.
  tl::expected<Recorder::NewFile, wire::Error> new_recording(const std::string& session_id, const std::string& name) const;
  /// A sheet that came with the attach.
  /// A sheet was changed by control: a recording that begins later has it as it is.
  static void keep_for_recordings(Guest& guest, const engine::SheetDescription& sheet);
  void take_attached(Guest& guest, const engine::SheetDescription& sheet);
  wire::ControlReply start_recording(Guest& guest, const std::string& file_name);
  /// Nothing: the answer follows when the file is closed.
  std::optional<wire::ControlReply> stop_recording(const wire::ControlPeer& peer, const wire::ControlRequest& request);
  void serve_recordings();
  void end_recordings();
  /// The session's recording is over, or there is none; else it is on the way.
  bool recording_is_over(const Guest& guest);

  // ---- daemon_page.cpp

  void serve_page();
  /// Sound that has gone out, for the page.
  void show(Guest& heard, const session::AudioBlock& block);
  std::optional<wire::Error> move_listener(Guest& asked, const sheet::Vec3d& position_m);

  const DaemonOptions options_;
  std::size_t max_sessions_;
  const std::shared_ptr<pack::PackLibrary> packs_;
  Heads heads_;
  std::map<std::filesystem::path, std::shared_ptr<const pack::SoundPack>> held_packs_;  ///< at the daemon's rate
  std::unique_ptr<PackReloads> reloads_;
  const std::shared_ptr<const session::WallClock> clock_;
  std::unique_ptr<wire::Sockets> sockets_;
  std::map<std::string, std::unique_ptr<Guest>> guests_;
  Strangers strangers_;
  Advertised advertised_;
  struct Spending {
    session::Allowance bytes, frames;
  };
  std::map<std::string, Spending> spending_;  ///< by user, of keys that have such quotas
  std::unique_ptr<session::Scheduler> scheduler_;
  std::unique_ptr<Recorder> recorder_;  ///< null: no folder
  std::unique_ptr<sinks::Playback> playback_;
  page::Page* page_ = nullptr;
  page::Host* page_host_ = nullptr;
  session::AudioBlock block_;
  NoticeTally complaints_;
  wire::Sockets::Counters told_;
  const Instant began_;
  monitor::Totals departed_;
  session::LoadLadder ladder_;
  session::Scheduler::Busy told_busy_;
  Instant looked_at_{}, served_all_at_{};
  bool draining_ = false;
  std::uint64_t next_name_ = 1;
};

}  // namespace rustle::apps
