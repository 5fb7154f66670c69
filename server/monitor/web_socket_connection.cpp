#include "server/monitor/web_socket_connection.h"

#include <atomic>
#include <boost/asio/buffer.hpp>
#include <boost/asio/post.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/field.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <utility>

namespace rustle::monitor {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using Error = beast::error_code;

constexpr std::chrono::seconds kHandshake{5};
constexpr std::chrono::seconds kIdle{60};
constexpr int kSendBuffer = 256 << 10;  // what is on its way cannot be replaced by something newer

class Connection : public std::enable_shared_from_this<Connection> {
 public:
  Connection(beast::tcp_stream stream, std::shared_ptr<WebSocketEnd> end, std::weak_ptr<asio::io_context> context,
             std::shared_ptr<void> place)
      : socket_(std::move(stream)), end_(std::move(end)), context_(std::move(context)), place_(std::move(place)) {}
  ~Connection() { leave(); }

  void accept(const http::request<http::empty_body>& request, const WebSocketTerms& terms) {
    auto& tcp = beast::get_lowest_layer(socket_);
    tcp.expires_never();
    Error ignored;
    tcp.socket().set_option(asio::socket_base::send_buffer_size(kSendBuffer), ignored);
    tcp.socket().set_option(asio::ip::tcp::no_delay(true), ignored);
    socket_.set_option(websocket::stream_base::timeout{kHandshake, kIdle, true});
    socket_.set_option(websocket::stream_base::decorator([name = terms.subprotocol](websocket::response_type& response) {
      response.set(http::field::sec_websocket_protocol, name);
    }));
    socket_.read_message_max(terms.message_bytes);
    socket_.auto_fragment(false);
    socket_.async_accept(request, [self = shared_from_this()](Error error) {
      if (error) return self->leave();
      self->stands_ = true;
      self->end_->opened(self->line());
      self->read();
      self->send();
    });
  }

 private:
  /// Does so on the server thread, where the connection still stands.
  template <class Do>
  static void post(const std::weak_ptr<asio::io_context>& context, std::weak_ptr<Connection> connection, Do what) {
    if (const auto there = context.lock()) {
      asio::post(*there, [connection = std::move(connection), what = std::move(what)]() mutable {
        if (const auto self = connection.lock()) what(*self);
      });
    }
  }

  WebSocketEnd::Line line() {
    const auto asked = std::make_shared<std::atomic<bool>>(false);
    return {[context = context_, self = weak_from_this(), asked] {
              if (asked->exchange(true)) return;
              post(context, self, [asked](Connection& connection) {
                asked->store(false);
                connection.send();
              });
            },
            [context = context_, self = weak_from_this()](std::string reason) {
              post(context, self, [reason = std::move(reason)](Connection& connection) { connection.close(reason); });
            }};
  }

  void read() {
    socket_.async_read(heard_, [self = shared_from_this()](Error error, std::size_t) {
      if (error) return self->leave();
      const std::string message = beast::buffers_to_string(self->heard_.data());
      self->heard_.consume(self->heard_.size());
      self->end_->heard(message, self->socket_.got_binary());
      self->read();
    });
  }

  void send() {
    if (!stands_ || sending_ || closing_) return;
    auto message = end_->next();
    if (!message) return;
    sending_ = true;
    socket_.binary(message->binary);
    const auto bytes = message->bytes;
    socket_.async_write(asio::buffer(*bytes), [self = shared_from_this(), bytes](Error error, std::size_t) {
      self->sending_ = false;
      if (error) return self->leave();
      self->send();
    });
  }

  void close(const std::string& reason) {
    if (!stands_ || std::exchange(closing_, true)) return;
    const websocket::close_reason why(websocket::close_code::policy_error,
                                      beast::string_view(reason.data(), std::min<std::size_t>(reason.size(), 120)));
    socket_.async_close(why, [self = shared_from_this()](Error) { self->leave(); });
  }

  void leave() {
    stands_ = false;
    if (std::exchange(left_, true)) return;
    end_->left();
    beast::get_lowest_layer(socket_).close();
  }

  websocket::stream<beast::tcp_stream> socket_;
  const std::shared_ptr<WebSocketEnd> end_;
  const std::weak_ptr<asio::io_context> context_;
  const std::shared_ptr<void> place_;
  beast::flat_buffer heard_;
  bool stands_ = false, sending_ = false, closing_ = false, left_ = false;
};

}  // namespace

void serve_web_socket(beast::tcp_stream stream, const http::request<http::empty_body>& request, const WebSocketTerms& terms,
                      std::shared_ptr<WebSocketEnd> end, const std::shared_ptr<asio::io_context>& context,
                      std::shared_ptr<void> place) {
  std::make_shared<Connection>(std::move(stream), std::move(end), context, std::move(place))->accept(request, terms);
}

}  // namespace rustle::monitor
