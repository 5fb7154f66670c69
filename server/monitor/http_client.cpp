#include "server/monitor/http_client.h"

#include <fmt/format.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>

namespace rustle::monitor {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;

constexpr std::uint64_t kLongestReply = std::uint64_t{64} << 20;

}  // namespace

tl::expected<HttpReply, std::string> http_ask(const HttpAddress& address, const HttpQuestion& question,
                                              std::chrono::milliseconds timeout) {
  asio::io_context context(1);
  beast::tcp_stream stream(context);
  beast::flat_buffer buffer;
  http::response_parser<http::string_body> parser;
  parser.body_limit(kLongestReply);
  http::request<http::string_body> request(http::string_to_verb(question.verb), question.target, 11);
  request.set(http::field::host, address.text());
  request.keep_alive(false);
  if (!question.json.empty()) {
    request.set(http::field::content_type, "application/json");
    request.body() = question.json;
    request.prepare_payload();
  }
  beast::error_code failed;
  const auto host = asio::ip::make_address(address.host, failed);
  if (!failed) {
    stream.expires_after(timeout);
    stream.async_connect(asio::ip::tcp::endpoint(host, address.port), [&](beast::error_code error) {
      failed = error;
      if (error) return;
      http::async_write(stream, request, [&](beast::error_code unsent, std::size_t) {
        failed = unsent;
        if (unsent) return;
        http::async_read(stream, buffer, parser, [&](beast::error_code unread, std::size_t) { failed = unread; });
      });
    });
    context.run();
  }
  if (failed) return tl::unexpected(failed.message());
  return HttpReply{static_cast<int>(parser.get().result_int()), std::move(parser.get().body())};
}

tl::expected<HttpReply, std::string> http_get(const HttpAddress& address, std::string_view target,
                                              std::chrono::milliseconds timeout) {
  auto reply = http_ask(address, {.target = std::string(target)}, timeout);
  if (!reply)
    return tl::unexpected(fmt::format("no daemon answers at {}: {}; start rustled, or name its --http address",
                                      address.text(), reply.error()));
  return reply;
}

std::string in_query(std::string_view text) {
  std::string out;
  for (const char each : text) {
    const auto byte = static_cast<unsigned char>(each);
    const bool plain = (byte >= '0' && byte <= '9') || (byte >= 'A' && byte <= 'Z') || (byte >= 'a' && byte <= 'z') ||
                       byte == '-' || byte == '_' || byte == '.' || byte == '~';
    if (plain) {
      out += each;
    } else {
      out += fmt::format("%{:02X}", byte);
    }
  }
  return out;
}

}  // namespace rustle::monitor
