#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include <boost/asio/io_context.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>

#include "server/monitor/web_socket.h"

namespace rustle::monitor {

struct WebSocketTerms {
  std::string subprotocol;
  std::size_t message_bytes = 4096;  ///< that the other end may send; more ends the connection (1009)
};

/// Accepts what the request asks for and serves it as long as both ends stand. Who says nothing for a minute, not even an
/// answer to a ping, is gone. `place` is held as long. [server thread]
void serve_web_socket(boost::beast::tcp_stream stream,
                      const boost::beast::http::request<boost::beast::http::empty_body>& request,
                      const WebSocketTerms& terms, std::shared_ptr<WebSocketEnd> end,
                      const std::shared_ptr<boost::asio::io_context>& context, std::shared_ptr<void> place);

}  // namespace rustle::monitor
