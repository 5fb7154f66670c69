#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include <tl/expected.hpp>

#include "server/monitor/figures.h"
#include "server/monitor/http_server.h"
#include "server/page/figures.h"
#include "server/page/painter.h"
#include "server/page/request.h"
#include "server/page/static_files.h"
#include "server/session/session.h"
#include "server/session/watch.h"

namespace rustle::page {

/// The daemon, as its page asks it. All [network thread]. A user is a public key, or empty: who gave none.
class Host {
 public:
  virtual ~Host() = default;
  /// `users`: whose rights are told.
  virtual Figures figures(const std::vector<std::string>& users) = 0;
  /// What the user may do at all, if need be with sessions of its own only.
  virtual Rights rights(const std::string& user) = 0;
  /// Keys are in force.
  virtual bool asks_for_keys() const = 0;
  /// The user of a secret key. Error: why it is not let in.
  virtual tl::expected<std::string, std::string> user_of(const std::string& secret) = 0;

  // Errors are sentences for people.
  using Done = tl::expected<void, std::string>;
  /// From now on the session is seen by this; null: by nobody.
  virtual Done watch(const std::string& session, std::shared_ptr<session::Watch> watch) = 0;
  virtual Done may_listen(const std::string& user, const std::string& session) = 0;
  virtual Done set_gain(const std::string& user, const std::string& session, const synthesis::Gain& gain) = 0;
  virtual Done move_listener(const std::string& user, const std::string& session, const sheet::Vec3d& position_m) = 0;
};

/// The daemon's page: what it shows of sessions, and what is asked from there.
///
///   analysis ── Watch ──────────────────────────┐
///   network ──── figures, PCM, answers ──► page thread ── encoded ──► outboxes ──► HTTP thread ──► viewers
///      ▲                                                                                │
///      └──────────────────────────── requests ──────────────────────────────────────────┘
///
/// Nobody waits for a viewer, and while there is none nothing is gathered, copied or encoded.
class Page {
 public:
  static constexpr int kMostAsked = 64;  ///< of a viewer, and not answered yet

  struct Options {
    std::filesystem::path folder;   ///< of the files
    std::string daemon;             ///< "rustled 0.1.0"
    std::uint32_t rate_hz = 48000;  ///< of sessions that do not say, as the channels
    int channels = 2;
    std::size_t viewers = 8;  ///< at a time
  };
  /// `wake`: ends the network thread's waiting. Thread-safe and quick.
  Page(Options options, std::function<void()> wake);
  /// \pre the HTTP server that served it is gone
  ~Page();

  /// Where its WebSocket and files are. The server must go before the page.
  void add_to(monitor::HttpServer::Paths& paths);

  // ---- [network thread]

  /// Somebody looks. Costs a load. [any thread]
  bool is_looked_at() const { return viewers_there_.load(std::memory_order_relaxed) > 0; }
  /// Answers what was asked and tells figures when they are due. To be called many times a second; costs two loads while
  /// nobody looks.
  void serve(Host& host);
  /// Sound of a session, block after block as they went out; kept only where somebody listens.
  void hear(const std::string& session, std::uint32_t rate_hz, const session::AudioBlock& block);
  /// The session is gone.
  void session_left(const std::string& session);
  /// Keys were read anew: who may not listen any more does not, and who was let in is told what it may now.
  void check_rights(Host& host);
  monitor::PageFigures figures() const;

 private:
  class Viewer;
  /// A viewer as the network thread knows it.
  struct Known {
    std::shared_ptr<Outlet> outlet;
    std::string user;
    std::string watched, heard;  ///< sessions; empty: none
  };
  /// What a viewer asked, and that it has come or gone.
  struct Came {
    std::shared_ptr<Outlet> outlet;
  };
  struct Gone {};
  struct Asked {
    ViewerId viewer;
    std::variant<Came, Gone, Request> what;
  };
  /// Sound that waits for a message to be worth sending.
  struct Heard {
    std::vector<float> waiting;
    std::int64_t first_sample = 0;
  };

  // ---- [HTTP thread]

  tl::expected<std::shared_ptr<monitor::WebSocketEnd>, monitor::HttpResponse> admit();
  void ask(Asked asked);

  // ---- [network thread]

  void answer(Host& host, Asked& asked);
  Host::Done carry_out(Host& host, ViewerId id, Known& known, const WatchRequest& request);
  Host::Done carry_out(Host& host, ViewerId id, Known& known, const ListenRequest& request);
  Host::Done carry_out(Host& host, ViewerId id, Known& known, const GainRequest& request);
  Host::Done carry_out(Host& host, ViewerId id, Known& known, const ListenerRequest& request);
  Host::Done carry_out(Host& host, ViewerId id, Known& known, const KeyRequest& request);
  void say_hello(Host& host, const Known& known) const;
  void stop_watching(Host& host, Known& known);
  void stop_listening(Known& known);
  void tell_figures(Host& host);

  const Options options_;
  const std::function<void()> wake_;
  const std::string machine_;
  const StaticFiles files_;
  std::atomic<std::size_t> viewers_there_{0};
  std::atomic<std::uint64_t> viewers_refused_{0}, messages_lost_{0};
  std::atomic<bool> asked_{false};
  std::mutex asked_mutex_;
  std::vector<Asked> asks_;
  ViewerId next_viewer_ = 1;  // HTTP thread

  std::map<ViewerId, Known> known_;                                 // network thread, as below
  std::map<std::string, std::shared_ptr<session::Watch>> watched_;  ///< by session
  std::map<std::string, Heard> heard_;                              ///< by session
  std::uint64_t frames_taken_ = 0;                                  ///< by watches that are over
  std::chrono::steady_clock::time_point figures_due_{};
  Painter painter_;  // last made, first destroyed
};

}  // namespace rustle::page
