#include <catch2/catch.hpp>

#include "server/apps/configuration.h"

namespace configuration_test {

using namespace rustle::apps;

TEST_CASE("The sidecar is where it is said, where Agones says, or nowhere") {
  CHECK_FALSE(sidecar_address("off", "9358")->has_value());
  CHECK_FALSE(sidecar_address("auto", nullptr)->has_value());
  CHECK_FALSE(sidecar_address("auto", "")->has_value());
  CHECK(sidecar_address("auto", "9358")->value().text() == "127.0.0.1:9358");
  CHECK(sidecar_address("[::1]:9000", "9358")->value().text() == "[::1]:9000");
}

TEST_CASE("What is no sidecar's address is told by the name of who said so") {
  for (const char* port : {"no port", "0", "*", "65536", "-1"}) {
    INFO(port);
    const auto address = sidecar_address("auto", port);
    REQUIRE_FALSE(address);
    CHECK(address.error().starts_with("AGONES_SDK_HTTP_PORT: "));
  }
  for (const char* text : {"", "9358", "203.0.113.4:9358", "127.0.0.1:0", "localhost"}) {
    INFO(text);
    const auto address = sidecar_address(text, "9358");
    REQUIRE_FALSE(address);
    CHECK(address.error().starts_with("fleet.sidecar: "));
  }
}

}  // namespace configuration_test
