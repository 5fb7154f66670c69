#include <catch2/catch.hpp>

#include "server/fleet/game_server.h"

namespace game_server_test {

namespace {

using namespace rustle::fleet;

constexpr const char* kTold = R"({"object_meta": {"name": "rustle-x7", "labels": {}},
  "status": {"state": "Scheduled", "address": "203.0.113.4",
             "ports": [{"name": "control", "port": 7101}, {"name": "stream", "port": 7205}, {"name": "out", "port": 7309}],
             "counters": {"sessions": {"count": "0", "capacity": "150"}}}})";

}  // namespace

TEST_CASE("What the sidecar tells of the game server is read") {
  const auto server = parse_game_server(kTold);
  REQUIRE(server);
  CHECK(server->name == "rustle-x7");
  CHECK(server->state == "Scheduled");
  CHECK(server->address == "203.0.113.4");
  CHECK(server->ports == std::map<std::string, std::uint16_t>{{"control", 7101}, {"stream", 7205}, {"out", 7309}});
}

TEST_CASE("What is no game server is none, and what is missing is empty") {
  for (const char* text : {"", "{", "[]", "null", "7", R"({"status": {}})", R"({"status": []})",
                           R"({"status": {"state": 3}})", R"({"object_meta": 3, "status": "Ready"})"}) {
    INFO(text);
    CHECK_FALSE(parse_game_server(text));
  }
  const auto early = parse_game_server(R"({"status": {"state": "Creating", "ports": null}})");
  REQUIRE(early);
  CHECK(early->address.empty());
  CHECK(early->ports.empty());
}

TEST_CASE("Ports that are none are left out") {
  const auto server = parse_game_server(
      R"({"status": {"state": "Ready", "ports": [{"name": "a", "port": 0}, {"name": "b", "port": 65536},
          {"name": "c", "port": "7"}, {"port": 7}, 7, {"name": "d"}, {"name": "e", "port": 65535}]}})");
  REQUIRE(server);
  CHECK(server->ports == std::map<std::string, std::uint16_t>{{"e", 65535}});
}

TEST_CASE("An endpoint is advertised by the node's port") {
  const GameServer server = *parse_game_server(kTold);
  CHECK(advertised("tcp://0.0.0.0:7391", server, "stream") == "tcp://0.0.0.0:7205");
  CHECK(advertised("tcp://[::]:7391", server, "stream") == "tcp://[::]:7205");
  CHECK(advertised("tcp://10.1.2.3:7392", server, "out") == "tcp://203.0.113.4:7309");
  CHECK_FALSE(advertised("tcp://0.0.0.0:7391", server, "other"));
  CHECK_FALSE(advertised("ipc:///run/rustle/stream", server, "stream"));
  CHECK_FALSE(advertised("", server, "stream"));
  GameServer six = server;
  six.address = "2001:db8::7";
  CHECK(advertised("tcp://[fd00::1]:7392", six, "out") == "tcp://[2001:db8::7]:7309");
}

}  // namespace game_server_test
