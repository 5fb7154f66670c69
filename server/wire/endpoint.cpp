#include "server/wire/endpoint.h"

#include <cerrno>
#include <charconv>
#include <cstddef>
#include <cstring>
#include <optional>

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <fmt/format.h>

namespace rustle::wire {
namespace {

constexpr std::string_view kTcp = "tcp://";
constexpr std::string_view kIpc = "ipc://";

struct HostAndPort {
  std::string_view host, port;
};

std::optional<HostAndPort> split_tcp(std::string_view endpoint) {
  const std::string_view address = endpoint.substr(kTcp.size());
  const std::size_t colon = address.rfind(':');
  if (colon == std::string_view::npos || colon == 0) return std::nullopt;
  const std::string_view host = address.substr(0, colon);
  if (host.find(':') != std::string_view::npos && (host.front() != '[' || host.back() != ']')) return std::nullopt;
  return HostAndPort{host, address.substr(colon + 1)};
}

std::optional<int> number_up_to(std::string_view text, int greatest) {
  int value = -1;
  const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (problem != std::errc() || end != text.data() + text.size() || value < 0 || value > greatest) return std::nullopt;
  return value;
}

bool is_loopback(std::string_view host) {
  if (host == "localhost" || host == "[::1]") return true;
  if (!host.starts_with("127.")) return false;
  int parts = 0;
  while (true) {
    const std::size_t dot = host.find('.');
    if (!number_up_to(host.substr(0, dot), 255)) return false;
    ++parts;
    if (dot == std::string_view::npos) return parts == 4;
    host.remove_prefix(dot + 1);
  }
}

tl::expected<std::string, std::string> check_ipc(std::string_view endpoint, std::string_view flag) {
  const std::string_view path = endpoint.substr(kIpc.size());
  constexpr std::size_t kLongest = sizeof(sockaddr_un::sun_path) - 1;
  if (path.empty() || path == "*")
    return tl::unexpected(
        fmt::format("{} {}: an ipc endpoint needs a path, such as ipc:///run/rustle/control.", flag, endpoint));
  if (path.size() > kLongest)
    return tl::unexpected(fmt::format("{} {}: the path has {} bytes, a socket's may have {}; choose a shorter one.", flag,
                                      endpoint, path.size(), kLongest));
  return std::string(endpoint);
}

tl::unexpected<std::string> not_an_endpoint(std::string_view endpoint, std::string_view flag) {
  return tl::unexpected(fmt::format("{} {}: no endpoint; write tcp://127.0.0.1:PORT or ipc://PATH.", flag, endpoint));
}

}  // namespace

tl::expected<std::string, std::string> check_bind_endpoint(std::string_view endpoint, std::string_view flag) {
  if (endpoint.starts_with(kIpc)) return check_ipc(endpoint, flag);
  if (!endpoint.starts_with(kTcp)) return not_an_endpoint(endpoint, flag);
  const auto parts = split_tcp(endpoint);
  if (!parts) return not_an_endpoint(endpoint, flag);
  if (parts->port != "*" && !number_up_to(parts->port, 65'535))
    return tl::unexpected(
        fmt::format("{} {}: \"{}\" is no port; give a number from 0 to 65535.", flag, endpoint, parts->port));
  const std::string_view host = parts->host == "localhost" ? "127.0.0.1" : parts->host;
  return fmt::format("{}{}:{}", kTcp, host, parts->port);
}

bool is_local(std::string_view endpoint) {
  if (endpoint.starts_with(kIpc)) return true;
  if (!endpoint.starts_with(kTcp)) return false;
  const auto parts = split_tcp(endpoint);
  return parts && is_loopback(parts->host);
}

tl::expected<std::string, std::string> check_connect_endpoint(std::string_view endpoint, std::string_view flag) {
  if (endpoint.starts_with(kIpc)) return check_ipc(endpoint, flag);
  if (!endpoint.starts_with(kTcp)) return not_an_endpoint(endpoint, flag);
  const auto parts = split_tcp(endpoint);
  if (!parts) return not_an_endpoint(endpoint, flag);
  const auto port = number_up_to(parts->port, 65'535);
  if (!port || *port == 0)
    return tl::unexpected(
        fmt::format("{} {}: \"{}\" is no port; give a number from 1 to 65535.", flag, endpoint, parts->port));
  if (parts->host == "*" || parts->host == "0.0.0.0")
    return tl::unexpected(
        fmt::format("{} {}: name the publisher's machine, such as tcp://127.0.0.1:{}.", flag, endpoint, parts->port));
  return std::string(endpoint);
}

bool ipc_in_use(std::string_view endpoint) {
  if (!endpoint.starts_with(kIpc)) return false;
  std::string path(endpoint.substr(kIpc.size()));
  sockaddr_un address{};
  if (path.empty() || path.size() >= sizeof(address.sun_path)) return false;
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, path.data(), path.size());
  auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + path.size());
  if (path.front() == '@') {
    address.sun_path[0] = '\0';
  } else {
    ++length;
  }
  const int probe = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (probe < 0) return false;
  const bool answered =
      ::connect(probe, static_cast<const sockaddr*>(static_cast<const void*>(&address)), length) == 0 || errno == EAGAIN;
  ::close(probe);
  return answered;
}

std::string_view port_of(std::string_view endpoint) {
  const std::size_t colon = endpoint.rfind(':');
  return colon == std::string_view::npos ? std::string_view{} : endpoint.substr(colon + 1);
}

}  // namespace rustle::wire
