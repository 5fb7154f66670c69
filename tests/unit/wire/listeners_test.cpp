#include <sys/socket.h>
#include <unistd.h>
#include <array>
#include <catch2/catch.hpp>

#include "server/wire/listeners.h"

namespace listeners_test {

using namespace rustle::wire;

namespace {

/// A connection of this process to itself.
struct Line {
  std::array<int, 2> ends{-1, -1};
  PeerConnection connection;

  Line() {
    REQUIRE(::socketpair(AF_UNIX, SOCK_STREAM, 0, ends.data()) == 0);
    connection = connection_at(ends[0]);
  }
  ~Line() { close(); }
  void close() {
    for (int& end : ends)
      if (end >= 0) ::close(std::exchange(end, -1));
  }
};

}  // namespace

TEST_CASE("a connection is known by its cookie, not by its descriptor alone", "[wire][listeners]") {
  Line first;
  const PeerConnection gone = first.connection;
  CHECK(is_open(gone));
  first.close();
  CHECK_FALSE(is_open(gone));
  Line second;  // has the descriptor now
  REQUIRE(second.connection.descriptor == gone.descriptor);
  CHECK_FALSE(is_open(gone));
  cut(gone);
  CHECK(::send(second.ends[1], "x", 1, MSG_NOSIGNAL) == 1);
  cut(second.connection);
  CHECK(::send(second.ends[1], "x", 1, MSG_NOSIGNAL) == -1);
}

TEST_CASE("a topic is heard while one that was granted it is there", "[wire][listeners]") {
  Listeners listeners;
  Line alice, bob;
  CHECK(listeners.grant("t", alice.connection, "a"));
  listeners.grant("t", alice.connection, "a");  // said twice
  CHECK_FALSE(listeners.grant("t", bob.connection, "b"));
  CHECK_FALSE(listeners.leave("t", alice.connection));
  CHECK(listeners.leave("t", bob.connection));
  CHECK_FALSE(listeners.leave("t", bob.connection));
}

TEST_CASE("who was refused and goes takes nobody's sound away", "[wire][listeners]") {
  const auto now = Listeners::Clock::now();
  Listeners listeners;
  Line alice, mallory;
  CHECK(listeners.grant("t", alice.connection, "a"));
  listeners.refuse("t", mallory.connection);
  CHECK(listeners.take_refusals(mallory.connection) == std::vector<std::string>{"t"});
  CHECK(listeners.take_refusals(mallory.connection).empty());
  SECTION("mallory goes, and alice later") {
    mallory.close();
    listeners.end("t");
    CHECK(listeners.settle(now).empty());
    alice.close();
    listeners.end("t");
    CHECK(listeners.settle(now) == std::vector<std::string>{"t"});
    CHECK(listeners.settle(now).empty());
  }
  SECTION("it is told before the connection is closed") {
    listeners.end("t");
    CHECK(listeners.settle(now).empty());
    alice.close();
    CHECK(listeners.settle(now) == std::vector<std::string>{"t"});
    Line carol;
    CHECK(listeners.grant("t", carol.connection, "c"));
  }
  SECTION("what is told of nobody who is known is forgotten") {
    for (int k = 0; k < 10; ++k) listeners.end("t");
    CHECK(listeners.settle(now + 2 * Listeners::kLook).empty());
    alice.close();
    CHECK(listeners.settle(now).empty());  // nobody told of alice
    listeners.end("t");
    CHECK(listeners.settle(now).size() == 1);
  }
}

TEST_CASE("listeners who may not stay are cut off, others are not", "[wire][listeners]") {
  Listeners listeners;
  Line alice, bob;
  listeners.grant("flag/pcm", alice.connection, "a");
  listeners.grant("flag/pcm", bob.connection, "b");
  listeners.cut_unless([](const std::string& user, const std::string&) { return user == "a"; });
  CHECK(::send(alice.ends[1], "x", 1, MSG_NOSIGNAL) == 1);
  CHECK(::send(bob.ends[1], "x", 1, MSG_NOSIGNAL) == -1);
}

TEST_CASE("topics beyond the limit are not kept", "[wire][listeners]") {
  Listeners listeners;
  Line alice;
  for (std::size_t k = 0; k < Listeners::kMostTopics; ++k) listeners.grant(std::to_string(k), alice.connection, "a");
  CHECK_FALSE(listeners.takes("one more"));
  CHECK(listeners.takes("7"));
}

}  // namespace listeners_test
