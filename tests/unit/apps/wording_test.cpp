#include <catch2/catch.hpp>

#include "server/apps/wording.h"

namespace wording_test {

using namespace rustle::apps;

TEST_CASE("one is singular", "[apps]") {
  CHECK(counted(0, "frame") == "0 frames");
  CHECK(counted(1, "frame") == "1 frame");
  CHECK(counted(2, "frame") == "2 frames");
  CHECK(counted(1, "topology") == "1 topology");
  CHECK(counted(3, "topology") == "3 topologies");
}

TEST_CASE("losses are told where there are any", "[apps]") {
  CHECK(to_string(Losses{}) == "nothing lost");
  CHECK(to_string(Losses{.voices_stolen = 3, .cues_dropped = 1}) == "lost: 3 voices stolen, 1 cue dropped");
  CHECK(to_string(Losses{.sounds_missing = 1}) == "lost: 1 sound missing in the pack");
}

}  // namespace wording_test
