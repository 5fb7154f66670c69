#include <catch2/catch.hpp>

#include "server/monitor/served_host.h"

namespace served_host_test {

using namespace rustle::monitor;

TEST_CASE("a request must call the server by its address or a name that is allowed", "[monitor]") {
  const std::vector<std::string> names = {"rustle.example.org"};
  const HttpAddress here{"127.0.0.1", 7393}, here_6{"::1", 7393}, lan{"192.168.1.5", 7393}, everywhere{"0.0.0.0", 7393};
  for (const char* host : {"127.0.0.1:7393", "127.0.0.1", "localhost:8080", "LOCALHOST", "[::1]:7393", "127.0.0.2:1",
                           "rustle.example.org", "Rustle.Example.org:443"}) {
    INFO(host);
    CHECK(is_served(host, here, names));
    CHECK(is_served(host, here_6, names));
  }
  for (const char* host :
       {"evil.example", "evil.example:7393", "127.0.0.1.evil.example", "localhost.evil.example", "192.168.1.5:7393",
        "rustle.example.org.evil.example", "", ":7393", "[::1", "2130706433", "127.1"}) {
    INFO(host);
    CHECK_FALSE(is_served(host, here, names));
  }
  CHECK(is_served("192.168.1.5:7393", lan, {}));
  CHECK_FALSE(is_served("192.168.1.6", lan, {}));
  CHECK_FALSE(is_served("localhost", lan, {}));
  CHECK(is_served("10.1.2.3:7393", everywhere, {}));  // an address cannot be made to lead elsewhere
  CHECK(is_served("[fe80::1]:7393", everywhere, {}));
  CHECK_FALSE(is_served("evil.example", everywhere, {}));
}

TEST_CASE("a page is this server's own where its origin is the host that was asked", "[monitor]") {
  CHECK(is_same_origin("http://127.0.0.1:7393", "127.0.0.1:7393"));
  CHECK(is_same_origin("https://rustle.example.org", "Rustle.example.org"));
  for (const char* origin : {"", "null", "http://127.0.0.1", "http://127.0.0.1:7394", "http://localhost:7393",
                             "http://127.0.0.1:7393.evil.example", "ftp://127.0.0.1:7393", "127.0.0.1:7393"}) {
    INFO(origin);
    CHECK_FALSE(is_same_origin(origin, "127.0.0.1:7393"));
  }
  CHECK_FALSE(is_same_origin("http://", ""));
}

TEST_CASE("names are plain, and who is reached from elsewhere has keys or wants it so", "[monitor]") {
  CHECK(is_host_name("rustle-1.example.org"));
  for (const char* name : {"", "http://rustle", "rustle:80", "a b", "a/b"}) CHECK_FALSE(is_host_name(name));
  CHECK(exposed({"127.0.0.1", 1}, false, false).empty());
  CHECK(exposed({"::1", 1}, false, false).empty());
  CHECK(exposed({"0.0.0.0", 1}, true, false).empty());
  CHECK(exposed({"0.0.0.0", 1}, false, true).empty());
  CHECK_THAT(exposed({"0.0.0.0", 0}, false, false), Catch::Contains("--keys") && Catch::Contains("127.0.0.1:PORT"));
}

}  // namespace served_host_test
