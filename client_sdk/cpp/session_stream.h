#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "client_sdk/cpp/attachment.h"
#include "client_sdk/cpp/connection.h"
#include "client_sdk/cpp/session.h"
#include "client_sdk/cpp/standing.h"
#include "client_sdk/cpp/subscription.h"
#include "client_sdk/cpp/types.h"

namespace rustle::client::internal {

/// What a session sends, and what comes back about it: numbering, flow control, notices, and going on at a daemon that came
/// back. Not for applications. One thread at a time; everything is done by the calls themselves.
class SessionStream {
 public:
  struct Start {
    Connection connection;
    std::string id;
    v1::Attach asked;        ///< as the daemon was asked
    SessionOptions options;  ///< as in force
    Streams streams;
    v1::FlowCredit credit;
    std::string recording_file_name;
    std::uint64_t breaks;  ///< of the control connection, when the session was attached
    bool reconnect;
    std::function<void(const Notice&)> on_notice;  ///< may be empty
  };

  explicit SessionStream(Start start);

  /// Numbers, stamps and sends. `keep_sequence`: the number is already there. `may_drop`: false: waits for room even where
  /// the live clock would leave the message out.
  SendResult send(v1::StreamMessage message, bool keep_sequence = false, bool may_drop = true);
  /// Errors: "timeout", "unreachable", the daemon's.
  tl::expected<void, Error> drain(std::chrono::milliseconds timeout);
  std::vector<Notice> poll_notices();
  tl::expected<Statistics, Error> detach(bool discard);
  /// The same without waiting for the answer.
  void tell_detach();
  /// Gains that a daemon that starts anew is told.
  void keep(const std::vector<Gain>& gains) { gains_ = gains; }
  /// What it was changed to by control; empty: as it was.
  void keep_pack(std::uint32_t sheet_id, const std::string& material, const std::string& touched_surface);
  /// A reader of this session's: a simulation waits for it to come back too.
  void keep(std::weak_ptr<Subscription> reader);

  const Connection& connection() const { return connection_; }
  const std::string& id() const { return id_; }
  const SessionOptions& options() const { return options_; }
  bool simulation() const { return options_.clock == rustle::client::Clock::kSimulation; }
  bool reconnects() const { return reconnect_; }
  bool detached() const { return detached_; }
  bool connected() const { return !recovery_ && pending_.empty() && !failure_; }
  std::uint64_t reattached() const { return reattached_; }
  std::uint64_t sent_messages() const { return sent_messages_; }
  std::uint64_t dropped_messages() const { return dropped_messages_; }
  std::uint64_t acknowledged_sequence() const { return acknowledged_; }
  std::uint64_t next_sequence() const { return next_sequence_; }
  const std::string& recording_file_name() const { return recording_file_name_; }
  void set_recording_file_name(std::string file_name) { recording_file_name_ = std::move(file_name); }
  std::uint64_t stored_sequence() const { return stored_sequence_; }

  std::chrono::milliseconds send_timeout{10'000};

 private:
  struct UnderWay {
    std::uint64_t sequence;
    std::size_t bytes;
    v1::StreamMessage message;  ///< empty unless it may have to be sent again
  };
  struct KnownSheet {
    std::string said;  ///< its description as sent last; in the same words again it changes nothing
    v1::Sheet now;     ///< and as changed since
  };

  void note(const v1::Sheet& sheet);
  /// To be sent before anything else, each sheet as it is now.
  void tell_again(std::vector<v1::StreamMessage> messages);
  void take(const v1::FlowCredit& credit);
  void take(const std::vector<std::string>& parts);
  void take_answers();
  bool has_room(std::size_t bytes) const;
  /// Whether the session can still be there; a step of bringing it back where it is not.
  tl::expected<void, Error> look();
  bool comes_back() const { return reconnect_ && !standing_.ended(); }
  void begin_recovery(bool ended);
  tl::expected<void, Error> recover();
  void begin_again();
  /// As the first time, with what was settled then; a simulation goes on from what was acknowledged.
  v1::Attach attach_again() const;
  bool readers_are_heard();
  /// Keeps for a daemon that is away.
  void put_off(v1::StreamMessage message);
  tl::expected<void, Error> send_pending();
  /// At once. False: there is no room.
  tl::expected<bool, Error> send_now(v1::StreamMessage& message, bool keep_sequence);
  template <typename Reached>
  tl::expected<void, Error> wait_until(std::chrono::milliseconds timeout, const Reached& reached);
  Error too_late(std::chrono::milliseconds waited) const;

  Connection connection_;
  const std::shared_ptr<Link> link_;
  const std::string id_;
  const v1::Attach asked_;
  const SessionOptions options_;
  Streams streams_;
  const bool reconnect_;
  const std::function<void(const Notice&)> on_notice_;

  std::uint64_t breaks_;  ///< of the control connection, when the session was last known to be there
  std::optional<Reattachment> recovery_{};
  Standing standing_{};
  std::map<std::uint32_t, KnownSheet> sheets_{};
  std::deque<v1::StreamMessage> pending_{};  ///< to be sent before anything else
  bool tell_all_ = false;                    ///< more was put off than `pending_` keeps
  std::vector<Gain> gains_{};
  std::vector<std::weak_ptr<Subscription>> readers_{};
  std::optional<Error> failure_{};  ///< for good
  std::optional<Error> lost_{};     ///< the daemon ended the session
  std::uint64_t reattached_ = 0;

  bool detached_ = false;
  std::uint64_t last_sequence_ = 0;  ///< of what was sent
  std::uint64_t next_sequence_ = 1;
  std::uint64_t sent_messages_ = 0;
  std::uint64_t dropped_messages_ = 0;
  std::deque<UnderWay> under_way_{};  ///< simulation clock: sent, not yet acknowledged
  std::size_t bytes_under_way_ = 0;
  std::uint64_t acknowledged_ = 0;
  std::string recording_file_name_{};
  std::uint64_t stored_sequence_ = 0;
  std::uint32_t window_messages_ = 0;
  std::uint64_t window_bytes_ = 0;
  std::deque<Notice> notices_{};
  std::deque<Notice> untold_{};  ///< to on_notice
};

}  // namespace rustle::client::internal
