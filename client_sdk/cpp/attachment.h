#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "client_sdk/cpp/transport.h"
#include "client_sdk/cpp/types.h"
#include "rustle/v1/session.pb.h"

/// How a session's two streams come to be in force, the first time and after a daemon restarted. Not for applications.
/// Nothing here waits: what has yet to arrive is looked for again with the next step, so that a LIVE session takes a step
/// whenever it sends.
namespace rustle::client::internal {

struct Streams {
  Socket stream;                                  ///< XPUB to the daemon's SUB
  Socket answers;                                 ///< SUB: credits and notices
  std::vector<std::vector<std::string>> early{};  ///< what came to `answers` meanwhile
};

/// Opens both streams of a session that the daemon has.
class StreamOpening {
 public:
  [[nodiscard]] static tl::expected<StreamOpening, Error> begin(const Link& link, const std::string& session_id,
                                                                rustle::client::Clock clock);
  /// True: the daemon takes the stream and publishes answers; nothing is lost from now on.
  bool step();
  /// Waits a little for what the next step needs.
  void wait(std::chrono::milliseconds timeout) const;
  /// \pre step() said so
  Streams take() { return std::move(streams_); }

 private:
  StreamOpening(Streams streams, std::string session_id, std::string marker);

  Streams streams_;
  std::string session_id_;
  std::string marker_;
  bool heard_ = false, taken_ = false;
};

/// Waits for a daemon, and attaches a session there under its old id unless the daemon still has it.
class Reattachment {
 public:
  struct Wanted {
    std::string session_id{};
    v1::Attach attach{};
    std::vector<Gain> gains{};
    rustle::client::Clock clock = rustle::client::Clock::kLive;
    bool ended = false;                ///< the daemon said that it ended the session; it may take a moment to forget it
    std::function<bool()> is_heard{};  ///< whether the session's readers have come back; they are waited for, a little
  };
  enum class Progress {
    kWaiting,
    kThere,     ///< the session was there all the time
    kAttached,  ///< see attached() and take_streams()
  };

  Reattachment(std::shared_ptr<Link> link, Wanted wanted);

  /// Errors: what the daemon refuses for good, such as a material it does not have.
  tl::expected<Progress, Error> step();

  const v1::Attached& attached() const { return *attached_; }
  Streams take_streams() { return opening_->take(); }

 private:
  enum class State { kBegin, kHello, kKnown, kAttach, kGains, kReaders, kStreams, kPause };
  /// An answer, or why there is none yet.
  struct Answer {
    enum class Kind { kWaiting, kNone, kReply, kRefused } kind;
    v1::ControlReply reply{};
    Error error{};
  };

  void ask(State state, v1::ControlRequest request);
  Answer answer();
  /// What follows from an answer; nothing: look again at once.
  tl::expected<std::optional<Progress>, Error> follow(Answer answer);
  tl::expected<std::optional<Progress>, Error> refused(const Error& error);
  void await_readers();
  void pause();
  void begin_again();

  const std::shared_ptr<Link> link_;
  const Wanted wanted_;
  State state_ = State::kBegin;
  std::optional<Socket> control_{};
  v1::ControlRequest request_{};
  bool sent_ = false;
  Clock::time_point deadline_{};
  std::uint64_t next_request_ = 1;
  std::optional<v1::Attached> attached_{};
  std::optional<StreamOpening> opening_{};
};

}  // namespace rustle::client::internal
