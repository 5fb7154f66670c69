#include <catch2/catch.hpp>

#include <map>
#include <set>
#include <string>

#include "server/session/inbox.h"

namespace inbox_test {

namespace {

using namespace rustle;
using session::Inbox;
using session::Offer;
using session::SequenceWindow;
using std::chrono::milliseconds;
using Arrival = SequenceWindow::Arrival;

TEST_CASE("Missing numbers are those that have not come, whatever the order") {
  SequenceWindow window;
  CHECK(window.add(40) == Arrival::kNext);  // a stream may be joined anywhere
  CHECK(window.add(41) == Arrival::kNext);
  CHECK(window.complete_before(42));
  CHECK(window.add(45) == Arrival::kNext);
  CHECK(window.missing() == 3);
  CHECK_FALSE(window.complete_before(45));
  CHECK(window.add(43) == Arrival::kLate);
  CHECK(window.add(43) == Arrival::kRepeated);
  CHECK(window.add(40) == Arrival::kRepeated);
  CHECK(window.add(12) == Arrival::kRepeated);  // from before it was joined
  CHECK(window.missing() == 2);
  CHECK(window.complete_before(42));
  CHECK_FALSE(window.complete_before(43));
  window.give_up_before(44);
  CHECK_FALSE(window.complete_before(45));
  CHECK(window.add(44) == Arrival::kLate);
  CHECK(window.complete_before(46));
  CHECK(window.missing() == 1);
}

TEST_CASE("Any order of numbers leaves missing exactly what did not come") {
  std::uint64_t noise = 5;
  const auto below = [&](std::uint64_t bound) {
    noise = noise * 6364136223846793005ULL + 1442695040888963407ULL;
    return (noise >> 33) % bound;
  };
  SequenceWindow window;
  std::set<std::uint64_t> come{1};
  window.add(1);
  std::uint64_t newest = 1;
  for (int k = 0; k < 20000; ++k) {
    const std::uint64_t number = below(4) == 0 ? newest - std::min(newest - 1, below(200)) : newest + 1 + below(3);
    const bool fresh = come.insert(number).second;
    const auto arrival = window.add(number);
    REQUIRE((arrival == Arrival::kRepeated) == !fresh);
    newest = std::max(newest, number);
    REQUIRE(window.missing() == newest - come.size());
  }
}

TEST_CASE("A number far back is a sender that has started again") {
  SequenceWindow window;
  for (std::uint64_t k = 1; k < 5000; ++k) window.add(k);
  CHECK(window.add(1) == Arrival::kNext);
  CHECK(window.add(2) == Arrival::kNext);
  CHECK(window.missing() == 0);
  CHECK(window.add(100000) == Arrival::kNext);
  CHECK(window.missing() == 99997);
  CHECK_FALSE(window.complete_before(100000));
}

/// An inbox and what went through it.
struct Used {
  explicit Used(bool live) : inbox(live) {}

  Offer frame(double time_s, std::uint64_t sequence, int at_ms = 0, sheet::SheetId sheet = 1, std::size_t bytes = 10) {
    sheet::MeshFrame frame;
    frame.sheet = sheet;
    frame.time_s = time_s;
    ++offered;
    return inbox.offer({std::move(frame), sequence, bytes, offered, milliseconds(at_ms), false});
  }
  /// The time of the next frame; -1: none.
  double take(int at_ms) {
    const auto next = inbox.take(milliseconds(at_ms), milliseconds(10));
    if (!next) return -1;
    ++taken;
    stepped_back = next->steps_back;
    return std::get<sheet::MeshFrame>(next->item).time_s;
  }
  std::map<std::string, int> lost() {
    for (const auto& one : inbox.take_lost()) ++all_lost[one.cause];
    return all_lost;
  }

  Inbox inbox;
  std::map<std::string, int> all_lost;
  std::uint64_t offered = 0, taken = 0;
  bool stepped_back = false;
};

using Lost = std::map<std::string, int>;

TEST_CASE("What comes after a missing message waits for it, but not long") {
  Used used(true);
  used.frame(1, 1);
  CHECK(used.take(0) == 1);
  used.frame(3, 3, 5);
  CHECK(used.take(5) == -1);
  CHECK(used.inbox.ready_at(milliseconds(10)) == milliseconds(15));
  SECTION("it comes in time and is put in its place") {
    used.frame(2, 2, 9);
    CHECK(used.take(9) == 2);
    CHECK(used.take(9) == 3);
    CHECK(used.lost().empty());
    CHECK(used.inbox.sequence_gaps() == 0);
  }
  SECTION("it comes too late and is dropped") {
    CHECK(used.take(15) == 3);
    used.frame(2, 2, 16);
    CHECK(used.take(16) == -1);
    CHECK(used.lost() == Lost{{"reordered", 1}});
    CHECK(used.inbox.sequence_gaps() == 0);
  }
  SECTION("it never comes") {
    used.frame(4, 4, 16);
    CHECK(used.take(16) == 3);
    CHECK(used.take(16) == 4);
    CHECK(used.inbox.sequence_gaps() == 1);
  }
  SECTION("it is a message that is no item") {
    used.inbox.pass_over(2);
    CHECK(used.take(6) == 3);
    CHECK(used.inbox.sequence_gaps() == 0);
  }
  SECTION("the stream ends meanwhile") {
    CHECK(used.inbox.offer({engine::End{}, 0, 0, 0, {}, false}) == Offer::kTaken);
    CHECK(used.take(6) == 3);
  }
}

TEST_CASE("Without numbers an older frame is reordered, the same time a duplicate") {
  Used used(true);
  used.frame(1.0, 0);
  CHECK(used.take(0) == 1.0);
  used.frame(1.1, 0);
  used.frame(1.1, 0);
  CHECK(used.take(0) == 1.1);
  used.frame(1.1, 0);
  used.frame(1.05, 0);
  CHECK(used.take(0) == -1);
  CHECK(used.lost() == Lost{{"duplicate", 2}, {"reordered", 1}});
  used.frame(1.05, 0, 0, 2);  // of another sheet
  CHECK(used.take(0) == 1.05);
}

TEST_CASE("A message that is repeated is a duplicate, a sender that counts anew is not") {
  Used used(true);
  for (std::uint64_t k = 1; k <= 5; ++k) {
    used.frame(static_cast<double>(k), k);
    used.take(0);
  }
  used.frame(3, 3);
  CHECK(used.lost() == Lost{{"duplicate", 1}});
  used.frame(6, 1);  // a newer time
  CHECK(used.take(0) == 6);
}

TEST_CASE("Time that steps back in sequence begins anew") {
  for (const bool numbered : {true, false}) {
    Used used(true);
    std::uint64_t sequence = 0;
    const auto send = [&](double time_s) { used.frame(time_s, numbered ? ++sequence : 0); };
    send(10);
    CHECK(used.take(0) == 10);
    CHECK_FALSE(used.stepped_back);
    send(0);
    CHECK(used.take(0) == 0);
    CHECK(used.stepped_back);
    send(0.1);
    CHECK(used.take(0) == 0.1);
    CHECK_FALSE(used.stepped_back);
    CHECK(used.lost().empty());
  }
}

TEST_CASE("The scene steps back with the sheets, once") {
  Used used(true);
  used.frame(10, 1);
  CHECK(used.inbox.offer({scene::SceneUpdate{10, {}, {}, {}, {}}, 2, 1, 2, {}, false}) == Offer::kTaken);
  CHECK(used.inbox.offer({scene::SceneUpdate{0, {}, {}, {}, {}}, 3, 1, 3, {}, false}) == Offer::kTaken);
  used.frame(0, 4);
  std::vector<bool> stepped;
  while (const auto next = used.inbox.take({}, {})) stepped.push_back(next->steps_back);
  CHECK(stepped == std::vector<bool>{false, false, true, false});
}

TEST_CASE("Three frames of a sheet wait, whatever its neighbours do") {
  Used used(true);
  std::uint64_t sequence = 0;
  for (int k = 0; k < 5; ++k) {
    for (sheet::SheetId sheet = 1; sheet <= 4; ++sheet) {
      if (sheet == 1 || k < 3) used.frame(k, ++sequence, 0, sheet);
    }
  }
  CHECK(used.lost() == Lost{{"backlog", 2}});
  CHECK(used.take(0) == 0);  // sheet 2's: sheet 1's oldest went
}

TEST_CASE("Frames that came are taken, dropped or waiting, in any disorder") {
  for (const std::uint64_t seed : {1, 2, 3}) {
    std::uint64_t noise = seed;
    const auto below = [&](std::uint64_t bound) {
      noise = noise * 6364136223846793005ULL + 1442695040888963407ULL;
      return (noise >> 33) % bound;
    };
    Used used(true);
    std::map<sheet::SheetId, double> newest;
    for (int k = 0; k < 5000; ++k) {
      const auto sequence = static_cast<std::uint64_t>(k) + 10 - below(10);
      const sheet::SheetId sheet = 1 + static_cast<sheet::SheetId>(below(2));
      used.frame(static_cast<double>(sequence) / 60, below(10) == 0 ? 0 : sequence, k, sheet);
      for (std::uint64_t takes = below(3); takes > 0; --takes) used.take(k);
      if (below(300) == 0) used.inbox.discard();
    }
    int lost = 0;
    for (const auto& [cause, count] : used.lost()) lost += count;
    std::uint64_t waiting = 0;
    for (; used.take(100000) >= 0; ++waiting) {
    }
    int lost_at_last = 0;
    for (const auto& [cause, count] : used.lost()) lost_at_last += count;
    CHECK(used.taken + static_cast<std::uint64_t>(lost_at_last) == used.offered);
    CHECK(used.inbox.empty());
    for (const char* cause : {"duplicate", "reordered", "backlog", "discarded"}) CHECK(used.all_lost[cause] > 0);
  }
}

TEST_CASE("On the simulation clock all is taken as it came") {
  Used used(false);
  used.frame(1, 1);
  used.frame(3, 3);
  used.frame(3, 3);
  used.frame(2, 2);
  for (const double expected : {1.0, 3.0, 3.0, 2.0}) CHECK(used.take(0) == expected);
  CHECK(used.lost().empty());
}

}  // namespace

}  // namespace inbox_test
