#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "server/monitor/figures.h"
#include "server/monitor/http_server.h"

namespace rustle::monitor {

/// What a running daemon tells over HTTP:
///   /metrics   everything for Prometheus
///   /healthz   200 while all is well, else 503; JSON with what is wrong
///   /figures   everything as JSON, which `rustle top` shows
///   /trace     ?session=ID [&frame=N | &sequence=N] [&newest=N]: when frames passed which station, JSON
///
///   HTTP thread ── asks, wakes ─► network thread
///        ▲                              │ answer(): plain data
///        └──────────────────────────────┘
///
/// Nothing is gathered while nobody asks.
class Monitor {
 public:
  /// `wake`: ends the network thread's waiting. Thread-safe and quick. `more`: what else is served there. Error: a sentence
  /// that names the address and the mend.
  [[nodiscard]] static tl::expected<std::unique_ptr<Monitor>, std::string> open(const HttpAddress& address,
                                                                                std::function<void()> wake,
                                                                                HttpServer::Paths more = {},
                                                                                const HttpServer::Options& options = {});
  ~Monitor();

  /// With the port the system chose. [any thread]
  const HttpAddress& address() const { return server_->address(); }

  /// How the daemon is asked. A session that is not there has no traces.
  struct Source {
    std::function<DaemonFigures()> figures;
    std::function<std::optional<SessionTraces>(const std::string& session)> traces;
  };
  /// Answers what has been asked. Called many times a second; costs a load when nothing was. [network thread]
  void answer(const Source& source);

 private:
  struct Question {
    std::optional<std::string> traces_of;  ///< absent: the daemon's figures
    /// What was asked for; null: there is none.
    std::function<void(std::shared_ptr<const DaemonFigures>, std::shared_ptr<const SessionTraces>)> answered;
  };
  explicit Monitor(std::function<void()> wake);
  void ask(Question question);
  /// A path whose response is made of the daemon's figures.
  HttpServer::Route of_figures(HttpResponse (*respond)(const DaemonFigures& daemon));
  void trace(const HttpRequest& request, HttpServer::Answer answer);

  const std::function<void()> wake_;
  std::mutex mutex_;
  std::vector<Question> questions_;
  std::atomic<bool> asked_{false};
  std::unique_ptr<HttpServer> server_;  // last made, first destroyed: its thread asks
};

}  // namespace rustle::monitor
