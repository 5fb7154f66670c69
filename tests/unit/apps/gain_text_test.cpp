#include "server/apps/gain_text.h"

#include <catch2/catch.hpp>
#include <limits>

namespace gain_text_test {

using rustle::apps::parse_gain;
using rustle::apps::to_text;
using rustle::synthesis::Gain;
using rustle::synthesis::SoundKind;

TEST_CASE("gains are read as people write them, and written so that they are read again", "[apps]") {
  const double silence_db = -std::numeric_limits<double>::infinity();
  const std::pair<const char*, Gain> gains[] = {
      {"all=-3", {-3, {}, {}, ""}},
      {"friction=-6", {-6, {}, SoundKind::kFriction, ""}},
      {"sheet:2=+3.5", {3.5, 2, {}, ""}},
      {"material:printer-paper=0", {0, {}, {}, "printer-paper"}},
      {"sheet:0,crumpling=-inf", {silence_db, 0, SoundKind::kCrumpling, ""}},
      {"tearing,material:a=b,sheet:4294967295=24", {24, 4294967295, SoundKind::kTearing, "a=b"}},
  };
  for (const auto& [text, gain] : gains) {
    CAPTURE(text);
    const auto read = parse_gain(text);
    REQUIRE(read.has_value());
    CHECK(*read == gain);
    CHECK(parse_gain(to_text(gain)) == gain);
  }
  CHECK(to_text({-6, 2, SoundKind::kFriction, "kraft"}) == "sheet:2,material:kraft,friction=-6");
  CHECK(to_text({2, {}, {}, ""}) == "all=+2");
}

TEST_CASE("what is no gain is quoted beside what would be one", "[apps]") {
  for (const char* text : {"",
                           "friction",
                           "=-6",
                           "friction=",
                           "friction=loud",
                           "friction=-6dB",
                           "friction=25",
                           "friction=nan",
                           "friction=inf",
                           "friction=-201",
                           "sheet:=1",
                           "sheet:x=1",
                           "sheet:-1=1",
                           "sheet:4294967296=1",
                           "material:=1",
                           "sheet:1,=1",
                           "friction,tearing=1",
                           "sheet:1,sheet:2=1",
                           "singing=1",
                           "all,friction=1",
                           "friction=++1"}) {
    CAPTURE(text);
    const auto read = parse_gain(text);
    REQUIRE_FALSE(read.has_value());
    CHECK(read.error().find('"' + std::string(text) + '"') != std::string::npos);
    CHECK(read.error().find("sheet:2,friction=-inf") != std::string::npos);
  }
}

}  // namespace gain_text_test
