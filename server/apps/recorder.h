#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "client_sdk/capture/storage_file.h"
#include "client_sdk/cpp/standing.h"
#include "server/session/session.h"
#include "server/sinks/recording.h"
#include "server/wire/control.h"
#include "server/wire/sockets.h"
#include "server/wire/stream_envelope.h"

namespace rustle::apps {

/// The recordings of a daemon's sessions, a file each in one folder: what arrived, when, and what the session decided.
///
///   arrived() ─┐
///              ├─ one order ─► sinks::Recording ─► file
///   decisions ─┘
///
/// session.proto says what a file holds in which order. A recording ends when its session has, when it is stopped, or when
/// the disk refuses. [network thread]
class Recorder {
 public:
  struct Options {
    std::filesystem::path folder;  ///< made where it is not there
    std::size_t queue_bytes = sinks::Recording::Options{}.queue_bytes;
    std::function<void()> changed;                                         ///< serve() has something to do; thread-safe
    std::function<void(const std::shared_ptr<session::Session>&)> settle;  ///< lets the session's analysis have a turn
  };
  /// Error: a sentence that names the setting, the folder and the mend.
  static tl::expected<std::unique_ptr<Recorder>, std::string> open(Options options, const session::WallClock& clock);

  struct NewFile {
    std::unique_ptr<capture::OutputFile> file;
    std::string name;
  };
  /// Makes a file in the folder: `wanted`, or where that is empty one named after session and time. Errors: MALFORMED (no
  /// plain name), STORAGE (there is such a file, the disk refuses).
  tl::expected<NewFile, wire::Error> create(const std::string& session_id, const std::string& wanted) const;

  /// What holds of a session that is under way.
  struct State {
    const client::internal::Standing& standing;
    const std::vector<synthesis::Gain>& gains;
    const std::optional<engine::ListenerMove>& listener;
    std::uint32_t load_level = 0;
  };
  /// Records from here on. `state` null: the session is recorded from its start, which its options say. `next_arrival`: of
  /// the next stream message. \pre it is not recorded
  void begin(NewFile file, const std::shared_ptr<session::Session>& session, const std::string& name, const State* state,
             std::uint64_t next_arrival);
  bool records(const session::Session& session) const { return entries_.contains(&session); }
  /// How far a session's recording has come; nothing where it is not recorded.
  std::optional<wire::RecordingProgress> progress(const session::Session& session) const;

  /// A stream message, before it is offered. `envelope` null: it cannot be read. Nothing where the session is not recorded.
  void arrived(const session::Session& session, const wire::StreamEnvelope* envelope, std::span<const std::byte> bytes);

  /// The session has ended or leaves: its recording ends as soon as all it decided is told.
  void finish(const session::Session& session);
  /// Ends the recording of the newest session of this id. The answer at once, or nothing: serve() has it later.
  std::optional<wire::ControlReply> stop(const std::string& session_id, const wire::ControlPeer& peer,
                                         std::uint64_t request_id);

  /// Something to tell about a recording.
  struct News {
    struct Answer {
      wire::ControlPeer peer;
      std::uint64_t request_id;
    };
    std::shared_ptr<session::Session> session;
    std::string file_name;
    std::optional<std::uint64_t> stored_sequence;  ///< everything up to it is on the disk
    std::optional<wire::Error> failure;            ///< the recording has ended by it
    std::optional<wire::ControlReply> ended;       ///< the recording has: the totals, or the failure
    std::vector<Answer> answers;                   ///< who asked for `ended`
  };
  /// Takes over what sessions decided and what the disk has done.
  std::vector<News> serve();
  bool idle() const { return entries_.empty(); }
  /// Ends every recording.
  void finish_all();

 private:
  struct Entry {
    std::shared_ptr<session::Session> session;
    std::string file_name;
    std::unique_ptr<sinks::Recording> recording;
    std::uint64_t decisions = 0;
    std::uint64_t stored_told = 0;
    std::optional<session::WallClock::Duration> settling_since;  ///< asked how far the sound is settled
    bool closing = false;
    std::vector<News::Answer> answers;
  };

  Recorder(Options options, const session::WallClock& clock);
  std::uint64_t log_time_ns() const;
  void decided(Entry& entry, const session::Decision& decision);
  void take_decisions(Entry& entry);
  void finish(Entry& entry);
  News news_of(Entry& entry);

  const Options options_;
  const session::WallClock& clock_;
  const std::int64_t epoch_ns_;  ///< of clock_'s zero, since 1970
  std::map<const session::Session*, Entry> entries_;
  std::map<std::string, wire::ControlReply> ended_;  ///< by session, of recordings that have ended
};

}  // namespace rustle::apps
