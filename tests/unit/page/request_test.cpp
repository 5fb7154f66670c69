#include <catch2/catch.hpp>
#include <cmath>

#include "server/page/request.h"

namespace page_request_test {
namespace {

using namespace rustle;
using namespace rustle::page;

template <class What>
What read(const char* text) {
  const auto request = parse_request(text);
  INFO(text);
  REQUIRE(request);
  REQUIRE(std::holds_alternative<What>(*request));
  return std::get<What>(*request);
}

}  // namespace

TEST_CASE("what a page asks is read", "[page]") {
  CHECK(read<WatchRequest>(R"({"type": "watch", "session": "a", "frames_per_second": 12})").frames_per_second == 12);
  CHECK(read<WatchRequest>(R"({"type": "watch", "session": "a"})").session == "a");
  CHECK_FALSE(read<WatchRequest>(R"({"type": "watch", "session": null})").session);
  CHECK_FALSE(read<ListenRequest>(R"({"type": "listen"})").session);
  CHECK(read<ListenRequest>(R"({"type": "listen", "session": "b"})").session == "b");
  const auto master = read<GainRequest>(R"({"type": "gain", "session": "a", "kind": "master", "db": -6.5})");
  CHECK((master.gain == synthesis::Gain{-6.5}));
  const auto silence = read<GainRequest>(R"({"type": "gain", "session": "a", "kind": "tearing", "db": null})");
  CHECK(silence.gain.kind == synthesis::SoundKind::kTearing);
  CHECK(std::isinf(silence.gain.gain_db));
  CHECK(read<ListenerRequest>(R"({"type": "listener", "session": "a", "position": [1, -2.5, 1e5]})").position_m ==
        sheet::Vec3d(1, -2.5, 1e5));
  CHECK(read<KeyRequest>(R"({"type": "key", "secret": "0123456789012345678901234567890123456789"})").secret.size() == 40);
}

TEST_CASE("what is no request is refused with a sentence", "[page]") {
  const std::string deep(4000, '[');
  for (const std::string& text :
       std::vector<std::string>{"",
                                "null",
                                "[1]",
                                "{",
                                deep,
                                "\xff\xfe",
                                R"({"type": "Watch"})",
                                R"({"session": "a"})",
                                R"({"type": "watch", "session": {}})",
                                R"({"type": "watch", "session": "a", "frames_per_second": "30"})",
                                R"({"type": "watch", "session": "a", "frames_per_second": 1e300})",
                                R"({"type": "gain", "session": "a", "kind": "crumpling", "db": 24.1})",
                                R"({"type": "gain", "session": "a", "kind": "crumpling", "db": -201})",
                                R"({"type": "gain", "session": "a", "kind": "crumpling", "db": 1e999})",
                                R"({"type": "gain", "session": "a", "kind": null, "db": 0})",
                                R"({"type": "listener", "session": "a", "position": [0, 0, 100001]})",
                                R"({"type": "listener", "session": "a", "position": [0, 0, 0, 0]})",
                                R"({"type": "listener", "session": "a", "position": "here"})",
                                R"({"type": "listener", "session": "a"})",
                                R"({"type": "key", "secret": 5})"}) {
    INFO(text.substr(0, 80));
    const auto request = parse_request(text);
    REQUIRE_FALSE(request);
    CHECK(request.error().back() == '.');
  }
}

}  // namespace page_request_test
