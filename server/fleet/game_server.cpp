#include "server/fleet/game_server.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

namespace rustle::fleet {
namespace {

using Json = nlohmann::json;

std::string text_of(const Json& object, const char* key) {
  const auto found = object.is_object() ? object.find(key) : object.end();
  return found != object.end() && found->is_string() ? found->get<std::string>() : std::string();
}

}  // namespace

std::optional<GameServer> parse_game_server(std::string_view json) {
  const Json all = Json::parse(json, nullptr, false);
  if (!all.is_object()) return std::nullopt;
  const Json about = all.value("object_meta", Json::object()), status = all.value("status", Json::object());
  GameServer server{text_of(about, "name"), text_of(status, "state"), text_of(status, "address"), {}};
  if (server.state.empty()) return std::nullopt;
  const auto ports = status.find("ports");
  if (ports == status.end() || !ports->is_array()) return server;
  for (const Json& port : *ports) {
    const std::string name = text_of(port, "name");
    const auto number = port.is_object() ? port.find("port") : port.end();
    if (name.empty() || number == port.end() || !number->is_number_integer()) continue;
    const auto value = number->get<std::int64_t>();
    if (value > 0 && value <= 65'535) server.ports[name] = static_cast<std::uint16_t>(value);
  }
  return server;
}

std::optional<std::string> advertised(const std::string& endpoint, const GameServer& server, const std::string& port) {
  constexpr std::string_view kTcp = "tcp://";
  const auto given = server.ports.find(port);
  if (given == server.ports.end() || !endpoint.starts_with(kTcp)) return std::nullopt;
  std::string host = endpoint.substr(kTcp.size(), endpoint.rfind(':') - kTcp.size());
  const bool everywhere = host == "0.0.0.0" || host == "[::]" || host == "*";
  if (!everywhere && !server.address.empty())
    host = server.address.find(':') == std::string::npos ? server.address : "[" + server.address + "]";
  return fmt::format("{}{}:{}", kTcp, host, given->second);
}

}  // namespace rustle::fleet
