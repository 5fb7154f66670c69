#include <catch2/catch.hpp>

#include "rustle/v1/session.pb.h"
#include "server/apps/strangers.h"

namespace strangers_test {

using namespace rustle;
using namespace rustle::apps;
using namespace std::chrono_literals;

namespace {

/// A sheet description of about that many bytes.
wire::StreamEnvelope said(const std::string& id, std::size_t bytes) {
  v1::StreamMessage message;
  message.set_session_id(id);
  message.mutable_topology()->set_triangles(std::string(bytes, 'x'));
  const std::string serialized = message.SerializeAsString();
  auto envelope = wire::StreamEnvelope::parse(std::as_bytes(std::span(serialized)), id);
  REQUIRE(envelope.has_value());
  return std::move(*envelope);
}

}  // namespace

TEST_CASE("strangers are held to messages, to bytes, and to bytes together", "[apps]") {
  Strangers strangers({.publishers = 3, .messages = 4, .bytes = 1000, .bytes_together = 1500});
  Stranger* one = strangers.meet("one", 1s);
  REQUIRE(one != nullptr);
  SECTION("messages") {
    for (int k = 0; k < 6; ++k) strangers.keep(*one, said("one", 1));
    CHECK(one->said.size() == 4);
    CHECK(one->left_out == 2);
  }
  SECTION("bytes") {
    strangers.keep(*one, said("one", 600));
    strangers.keep(*one, said("one", 600));
    strangers.keep(*one, said("one", 100));
    CHECK(one->said.size() == 2);
    CHECK(one->left_out == 1);
    CHECK(one->bytes == one->said[0].bytes() + one->said[1].bytes());
  }
  SECTION("bytes together, which come free again") {
    strangers.keep(*one, said("one", 900));
    Stranger* two = strangers.meet("two", 2s);
    REQUIRE(two != nullptr);
    strangers.keep(*two, said("two", 700));
    CHECK(two->left_out == 1);
    CHECK(strangers.take("one").said.size() == 1);
    strangers.keep(*two, said("two", 700));
    CHECK(two->said.size() == 1);
    CHECK(strangers.forget_before(3s) == 2);
    CHECK(strangers.empty());
    Stranger* three = strangers.meet("three", 3s);
    REQUIRE(three != nullptr);
    strangers.keep(*three, said("three", 900));
    CHECK(three->said.size() == 1);
  }
  SECTION("and to their number") {
    CHECK(strangers.meet("two", 2s) != nullptr);
    CHECK(strangers.meet("three", 2s) != nullptr);
    CHECK(strangers.meet("four", 2s) == nullptr);
    CHECK(strangers.meet("one", 2s) == one);
    CHECK(strangers.forget_before(2s) == 0);
    CHECK(strangers.meet("four", 2s) != nullptr);
  }
}

}  // namespace strangers_test
