#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <tl/expected.hpp>

#include "server/monitor/http_address.h"
#include "server/monitor/web_socket.h"

namespace rustle::monitor {

/// What a browser or a scraper asks: always GET or HEAD.
struct HttpRequest {
  std::string path;                          ///< "/trace", decoded
  std::map<std::string, std::string> query;  ///< "session" → "flag", decoded; of several the last
  std::string host;                          ///< "127.0.0.1:7393", as the client called the server; may be empty
};

struct HttpResponse {
  int status = 200;
  std::string type = "text/plain; charset=utf-8";
  std::string body;
  std::string keep = "no-store";                            ///< Cache-Control
  std::vector<std::pair<std::string, std::string>> more{};  ///< header fields
};

/// Serves a few paths, files and WebSockets, on a thread of its own (Boost.Beast). Whoever connects is bounded: so many
/// connections, so long a header, so long for a request to come and an answer to go; requests of one connection are answered
/// one after the other.
///
///   malformed 400 · not for this Host, or a WebSocket of another's page 403 · unknown path 404 · other methods 405 ·
///   no WebSocket asked for 426 · header or target too long 431 · no connection left 503
class HttpServer {
 public:
  /// Makes the response. [server thread]
  using Response = std::function<HttpResponse()>;
  /// Answers once, from any thread.
  using Answer = std::function<void(Response response)>;
  struct Route {
    /// [server thread] It must not wait.
    std::function<void(const HttpRequest& request, Answer answer)> handler;
    /// What a client gets where no answer has come within Options::answer_within.
    HttpResponse late{503, "text/plain; charset=utf-8", "The daemon does not answer.\n"};
  };

  /// A path where WebSockets are served, to pages of this server's own.
  struct SocketRoute {
    std::string subprotocol;
    std::size_t message_bytes = 4096;  ///< that a client may send
    /// [server thread] Our end, or why there is none. It must not wait.
    std::function<tl::expected<std::shared_ptr<WebSocketEnd>, HttpResponse>()> admit;
  };
  struct Paths {
    std::map<std::string, Route> routes;
    std::map<std::string, SocketRoute> sockets{};
    /// [server thread] Of all other paths; absent: there is nothing.
    std::function<std::optional<HttpResponse>(const HttpRequest& request)> files{};
  };

  struct Options {
    /// Whether requests that call the server so are answered; empty: all are. `own`: with the port the system chose.
    std::function<bool(std::string_view host, const HttpAddress& own)> serves{};
    std::size_t connections = 32;
    std::size_t header_bytes = 8192;
    std::chrono::milliseconds request_within{5000};  ///< also how long a connection may be idle
    std::chrono::milliseconds send_within{5000};
    std::chrono::milliseconds answer_within{1000};
  };

  /// Error: a sentence that names the address and the mend.
  [[nodiscard]] static tl::expected<std::unique_ptr<HttpServer>, std::string> open(const HttpAddress& address, Paths paths,
                                                                                   const Options& options);
  /// Ends connections as they are; a handler's answer that is still to come is ignored.
  ~HttpServer();
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  /// With the port the system chose. [any thread]
  const HttpAddress& address() const;

 private:
  struct Impl;
  explicit HttpServer(std::unique_ptr<Impl> impl);
  const std::unique_ptr<Impl> impl_;
};

}  // namespace rustle::monitor
