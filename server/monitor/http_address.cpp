#include "server/monitor/http_address.h"

#include <fmt/format.h>

#include <boost/asio/ip/address.hpp>
#include <charconv>

namespace rustle::monitor {

std::string HttpAddress::text() const {
  return host.find(':') == std::string::npos ? fmt::format("{}:{}", host, port) : fmt::format("[{}]:{}", host, port);
}

bool HttpAddress::is_local() const {
  boost::system::error_code none;
  return boost::asio::ip::make_address(host, none).is_loopback();
}

tl::expected<HttpAddress, std::string> parse_http_address(std::string_view text, std::string_view setting) {
  const std::size_t colon = text.rfind(':');
  const std::string_view port = colon == std::string_view::npos ? std::string_view() : text.substr(colon + 1);
  std::string host(text.substr(0, colon));
  if (host == "localhost") host = "127.0.0.1";
  if (host.size() > 2 && host.front() == '[' && host.back() == ']') host = host.substr(1, host.size() - 2);
  boost::system::error_code wrong;
  const auto address = boost::asio::ip::make_address(host, wrong);
  unsigned number = 0;
  const auto [end, failed] = std::from_chars(port.data(), port.data() + port.size(), number);
  const bool any_port = port == "*";
  if (wrong || (!any_port && (failed != std::errc() || end != port.data() + port.size() || number > 65'535)))
    return tl::unexpected(
        fmt::format("{}: \"{}\" is no address with a port; write 127.0.0.1:7393, or \"off\"", setting, text));
  return HttpAddress{address.to_string(), any_port ? std::uint16_t{0} : static_cast<std::uint16_t>(number)};
}

std::string exposed(const HttpAddress& address, bool keys, bool insecure) {
  if (address.is_local() || keys || insecure) return {};
  return fmt::format(
      "--http {}: whoever reaches it could change what sounds here. Have keys asked for with --keys FOLDER (`rustle keys "
      "new "
      "server` makes the first), bind 127.0.0.1:{} and reach it through a tunnel (ssh -L), or say --insecure.",
      address.text(), address.port == 0 ? "PORT" : std::to_string(address.port));
}

}  // namespace rustle::monitor
