#include "server/monitor/http_server.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <optional>
#include <string_view>
#include <thread>
#include <utility>

#include "server/monitor/served_host.h"
#include "server/monitor/web_socket_connection.h"
#include "server/session/worker_thread.h"

namespace rustle::monitor {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using tcp = asio::ip::tcp;
using Error = beast::error_code;

constexpr std::chrono::milliseconds kAcceptAgain{200};  // after the system had no descriptor left

int hex_of(char digit) {
  if (digit >= '0' && digit <= '9') return digit - '0';
  if (digit >= 'a' && digit <= 'f') return digit - 'a' + 10;
  if (digit >= 'A' && digit <= 'F') return digit - 'A' + 10;
  return -1;
}

/// %41 and + as they are meant; absent: not so written.
std::optional<std::string> decoded(std::string_view text, bool plus_is_space) {
  std::string out;
  for (std::size_t k = 0; k < text.size(); ++k) {
    if (text[k] == '+' && plus_is_space) {
      out += ' ';
    } else if (text[k] == '%') {
      if (k + 2 >= text.size()) return std::nullopt;
      const int high = hex_of(text[k + 1]), low = hex_of(text[k + 2]);
      if (high < 0 || low < 0) return std::nullopt;
      out += static_cast<char>(16 * high + low);
      k += 2;
    } else {
      out += text[k];
    }
  }
  return out;
}

std::optional<HttpRequest> parse_target(std::string_view target) {
  HttpRequest out;
  if (target.empty() || target.front() != '/') return std::nullopt;
  const std::size_t mark = target.find('?');
  auto path = decoded(target.substr(0, mark), false);
  if (!path) return std::nullopt;
  out.path = std::move(*path);
  std::string_view rest = mark == std::string_view::npos ? std::string_view() : target.substr(mark + 1);
  while (!rest.empty()) {
    const std::size_t end = std::min(rest.find('&'), rest.size());
    const std::string_view pair = rest.substr(0, end);
    rest.remove_prefix(std::min(end + 1, rest.size()));
    const std::size_t equals = std::min(pair.find('='), pair.size());
    auto key = decoded(pair.substr(0, equals), true);
    auto value = decoded(pair.substr(std::min(equals + 1, pair.size())), true);
    if (!key || !value) return std::nullopt;
    out.query[std::move(*key)] = std::move(*value);
  }
  return out;
}

/// One of the connections that there may be.
class Place {
 public:
  explicit Place(std::shared_ptr<std::size_t> taken) : taken_(std::move(taken)) { ++*taken_; }
  ~Place() { --*taken_; }
  Place(const Place&) = delete;
  Place& operator=(const Place&) = delete;

 private:
  const std::shared_ptr<std::size_t> taken_;
};

}  // namespace

/// What the server thread works on. Its handlers run between open() and ~HttpServer(), so they may refer to it.
struct HttpServer::Impl {
  class Connection;

  Impl(Paths its_paths, const Options& its_options)
      : options(its_options), paths(std::move(its_paths)), acceptor(*context), again(*context) {}

  void accept();

  const Options options;
  const Paths paths;
  const std::shared_ptr<asio::io_context> context = std::make_shared<asio::io_context>(1);
  tcp::acceptor acceptor;
  asio::steady_timer again;
  const std::shared_ptr<std::size_t> connections = std::make_shared<std::size_t>(0);
  HttpAddress address;
  std::thread thread;
};

/// One client. Lives as long as something is under way for it.
class HttpServer::Impl::Connection : public std::enable_shared_from_this<Connection> {
 public:
  Connection(Impl& server, tcp::socket socket)
      : server_(server),
        place_(std::make_shared<Place>(server.connections)),
        stream_(std::move(socket)),
        deadline_(*server.context) {}

  void read() {
    parser_.emplace();
    parser_->header_limit(static_cast<std::uint32_t>(server_.options.header_bytes));
    parser_->body_limit(0);
    stream_.expires_after(server_.options.request_within);
    http::async_read(stream_, buffer_, *parser_,
                     [self = shared_from_this()](Error error, std::size_t) { self->heard(error); });
  }

  void refuse(int status, const char* why) {
    keep_alive_ = false;
    send({status, "text/plain; charset=utf-8", fmt::format("{}\n", why)});
  }

 private:
  void heard(Error error) {
    head_only_ = false;
    if (error == http::error::end_of_stream) return close();
    if (error == http::error::header_limit || error == http::error::buffer_overflow)
      return refuse(431, "The request's header is too long.");
    if (error == http::error::body_limit || error == http::error::unexpected_body)
      return refuse(413, "A request has no body here.");
    if (error.category() == http::make_error_code(http::error::bad_version).category())
      return refuse(400, "This is no HTTP request.");
    if (error) return;  // too slow, or gone
    const auto& request = parser_->get();
    keep_alive_ = request.keep_alive();
    head_only_ = request.method() == http::verb::head;
    if (request.method() != http::verb::get && !head_only_) return refuse(405, "Only GET and HEAD are answered here.");
    auto asked = parse_target({request.target().data(), request.target().size()});
    if (!asked) return refuse(400, "This is no path.");
    const auto host = request[http::field::host];
    asked->host.assign(host.data(), host.size());
    // What is no browser need not say whom it calls.
    if (!asked->host.empty() && server_.options.serves && !server_.options.serves(asked->host, server_.address))
      return refuse(403, "This daemon is not served under that name; allow it with --http-name NAME.");
    if (const auto socket = server_.paths.sockets.find(asked->path); socket != server_.paths.sockets.end())
      return upgrade(socket->second, asked->host);
    const auto route = server_.paths.routes.find(asked->path);
    if (route == server_.paths.routes.end()) {
      if (auto file = server_.paths.files ? server_.paths.files(*asked) : std::nullopt) return send(std::move(*file));
      std::string known;
      for (const auto& [path, known_route] : server_.paths.routes) known += " " + path;
      return send({404, "text/plain; charset=utf-8", fmt::format("There is nothing here. There are:{}\n", known)});
    }
    await_answer(route->second.late);
    // The answer may come from any thread and after the server's end.
    route->second.handler(
        *asked, [self = weak_from_this(), context = std::weak_ptr(server_.context), turn = turn_](Response response) {
          const auto there = context.lock();
          if (!there) return;
          asio::post(*there, [self, turn, response = std::move(response)] {
            if (const auto connection = self.lock()) connection->answered(turn, response);
          });
        });
  }

  void upgrade(const SocketRoute& route, const std::string& host) {
    const auto& request = parser_->get();
    if (!beast::websocket::is_upgrade(request)) return refuse(426, "This path is for WebSockets.");
    const auto origin = request[http::field::origin];
    if (!is_same_origin({origin.data(), origin.size()}, host))
      return refuse(403, "Only a page that came from this daemon may connect here (Origin must be the Host asked).");
    http::token_list offered(request[http::field::sec_websocket_protocol]);
    if (!offered.exists(route.subprotocol) || buffer_.size() > 0) {
      keep_alive_ = false;
      return send({400, "text/plain; charset=utf-8", fmt::format("This path speaks {}.\n", route.subprotocol)});
    }
    auto end = route.admit();
    if (!end) {
      keep_alive_ = false;
      return send(std::move(end.error()));
    }
    serve_web_socket(std::move(stream_), request, {route.subprotocol, route.message_bytes}, std::move(*end), server_.context,
                     place_);
  }

  /// Keeps the connection until the handler has answered, but not for ever.
  void await_answer(const HttpResponse& late) {
    deadline_.expires_after(server_.options.answer_within);
    deadline_.async_wait(
        [self = shared_from_this(), turn = turn_, &late](Error) { self->answered(turn, [&late] { return late; }); });
  }

  void answered(std::uint64_t turn, const Response& response) {
    if (turn != turn_) return;  // the other one came first
    ++turn_;
    deadline_.cancel();
    send(response());
  }

  void send(HttpResponse response) {
    auto message = std::make_shared<http::response<http::string_body>>();
    message->version(11);
    message->result(static_cast<unsigned>(response.status));
    message->set(http::field::content_type, response.type);
    message->set(http::field::cache_control, response.keep);
    for (const auto& [name, value] : response.more) message->set(name, value);
    if (response.status == 405) message->set(http::field::allow, "GET, HEAD");
    message->keep_alive(keep_alive_);
    message->body() = std::move(response.body);
    message->prepare_payload();
    const auto sent = [self = shared_from_this(), message](Error error, std::size_t) {
      if (error) return;
      if (self->keep_alive_) {
        self->read();
      } else {
        self->close();
      }
    };
    stream_.expires_after(server_.options.send_within);
    if (!head_only_) return http::async_write(stream_, *message, sent);
    auto header = std::make_shared<http::response_serializer<http::string_body>>(*message);
    http::async_write_header(stream_, *header, [header, sent](Error error, std::size_t size) { sent(error, size); });
  }

  /// Says that nothing more comes, and waits for the client to hang up: closing at once could take the answer from it.
  void close() {
    Error ignored;
    stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
    stream_.expires_after(std::chrono::milliseconds(500));
    stream_.async_read_some(asio::buffer(rest_), [self = shared_from_this()](Error error, std::size_t) {
      if (!error && --self->rests_ > 0) self->close();
    });
  }

  Impl& server_;
  const std::shared_ptr<Place> place_;
  beast::tcp_stream stream_;
  asio::steady_timer deadline_;
  beast::flat_buffer buffer_{16384};
  std::optional<http::request_parser<http::empty_body>> parser_;
  std::array<char, 4096> rest_;
  int rests_ = 16;
  std::uint64_t turn_ = 0;
  bool keep_alive_ = false, head_only_ = false;
};

void HttpServer::Impl::accept() {
  acceptor.async_accept([this](Error error, tcp::socket socket) {
    if (error == asio::error::operation_aborted) return;
    if (error) {
      again.expires_after(kAcceptAgain);
      again.async_wait([this](Error stopped) {
        if (!stopped) accept();
      });
      return;
    }
    const bool room = *connections < options.connections;
    // A few more, to say why they are turned away.
    if (*connections < 2 * options.connections) {
      const auto connection = std::make_shared<Connection>(*this, std::move(socket));
      if (room) {
        connection->read();
      } else {
        connection->refuse(503, "Too many connections.");
      }
    }
    accept();
  });
}

HttpServer::HttpServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

tl::expected<std::unique_ptr<HttpServer>, std::string> HttpServer::open(const HttpAddress& address, Paths paths,
                                                                        const Options& options) {
  auto impl = std::make_unique<Impl>(std::move(paths), options);
  Error error;
  const tcp::endpoint endpoint(asio::ip::make_address(address.host, error), address.port);
  if (!error) impl->acceptor.open(endpoint.protocol(), error);
  if (!error) impl->acceptor.set_option(asio::socket_base::reuse_address(true), error);
  if (!error) impl->acceptor.bind(endpoint, error);
  if (!error) impl->acceptor.listen(asio::socket_base::max_listen_connections, error);
  if (error)
    return tl::unexpected(
        fmt::format("--http {}: {}; give another address or port, \"127.0.0.1:*\" for any that is free, or \"off\"",
                    address.text(), error.message()));
  impl->address = {address.host, impl->acceptor.local_endpoint().port()};
  impl->accept();
  impl->thread = std::thread([server = impl.get()] {
    session::name_this_thread("rustle-http");
    server->context->run();
  });
  return std::unique_ptr<HttpServer>(new HttpServer(std::move(impl)));
}

HttpServer::~HttpServer() {
  impl_->context->stop();
  impl_->thread.join();
}

const HttpAddress& HttpServer::address() const {
  return impl_->address;
}

}  // namespace rustle::monitor
