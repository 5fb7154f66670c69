#include <catch2/catch.hpp>
#include <string>
#include <vector>

#include "server/page/outbox.h"

namespace page_outbox_test {
namespace {

using namespace rustle::page;

std::shared_ptr<const std::string> bytes(std::string text) {
  return std::make_shared<const std::string>(std::move(text));
}

std::vector<std::string> all_of(Outbox& box) {
  std::vector<std::string> out;
  while (const auto message = box.next()) out.push_back(*message->bytes);
  return out;
}

using Texts = std::vector<std::string>;

}  // namespace

TEST_CASE("what is read in time comes in its order, a topology before what needs it, once", "[page]") {
  Outbox box;
  const Needed mesh{0, {bytes("mesh"), true}}, other{1, {bytes("other"), true}};
  box.add_frame(0, bytes("frame 1"), mesh);
  box.add_text("hello");
  box.add_frame(1, bytes("frame of another"), other);
  CHECK(all_of(box) == Texts{"mesh", "frame 1", "hello", "other", "frame of another"});
  box.add_frame(0, bytes("frame 2"), mesh);
  CHECK(all_of(box) == Texts{"frame 2"});
  box.add_frame(0, bytes("frame 3"), {0, {bytes("new mesh"), true}});
  CHECK(all_of(box) == Texts{"new mesh", "frame 3"});
  box.forget_pictures();  // another session's may be next
  box.add_frame(0, bytes("frame 4"), mesh);
  CHECK(all_of(box) == Texts{"mesh", "frame 4"});
  box.add_scene(bytes("scene"), {{kObstaclePlaces, {bytes("table"), true}}});
  CHECK(all_of(box) == Texts{"table", "scene"});
  const auto lost = box.lost();
  CHECK(lost.pictures + lost.events + lost.pcm == 0);
}

TEST_CASE("of pictures that nobody reads the newest two are kept, and the topology of the last", "[page]") {
  Outbox box;
  for (int k = 0; k < 10; ++k) {
    const auto mesh = bytes("mesh " + std::to_string(k));
    box.add_frame(0, bytes("frame " + std::to_string(k)), {0, {mesh, true}});
    box.add_frame(1, bytes("other " + std::to_string(k)), {1, {bytes("its"), true}});
    box.add_figures("figures " + std::to_string(k));
    box.add_scene(bytes("scene " + std::to_string(k)), {});
  }
  const auto heard = all_of(box);
  CHECK(std::count(heard.begin(), heard.end(), "frame 8") == 1);
  CHECK(std::count(heard.begin(), heard.end(), "frame 7") == 0);
  CHECK(std::find(heard.begin(), heard.end(), "mesh 9") + 1 == std::find(heard.begin(), heard.end(), "frame 9"));
  CHECK(std::count(heard.begin(), heard.end(), "other 9") == 1);
  CHECK(std::count(heard.begin(), heard.end(), "figures 8") == 1);
  CHECK(std::count(heard.begin(), heard.end(), "scene 9") == 1);
  CHECK(heard.size() == 4 * 2 + 2 + 2);
  CHECK(box.lost().pictures == 4 * 8);
}

TEST_CASE("a second of sound waits, and then there is a gap", "[page]") {
  Outbox box;
  for (int k = 0; k < 20; ++k) box.add_pcm(bytes(std::to_string(k)), 0.125);
  CHECK(all_of(box) == Texts{"0", "1", "2", "3", "4", "5", "6", "7"});
  CHECK(box.lost().pcm == 12);
  box.add_pcm(bytes("20"), 0.125);
  CHECK(all_of(box) == Texts{"20"});
  box.add_pcm(bytes("21"), 0.125);
  box.forget_pcm();
  CHECK(all_of(box).empty());
}

TEST_CASE("the oldest events go, and no notice does until the viewer asks without reading", "[page]") {
  Outbox box;
  for (std::size_t k = 0; k < Outbox::kEvents + 3; ++k) box.add_events(bytes(std::to_string(k)));
  CHECK(box.lost().events == 3);
  CHECK(*box.next()->bytes == "3");
  for (std::size_t k = 0; k < Outbox::kTexts; ++k) CHECK(box.add_text("notice"));
  CHECK_FALSE(box.add_text("one more"));
}

TEST_CASE("beyond so many bytes nothing large is taken", "[page]") {
  Outbox box;
  const auto large = bytes(std::string(Outbox::kBytes / 3, 'x'));
  for (std::uint32_t place = 0; place < 8; ++place) box.add_frame(place, large, {place, {bytes("mesh"), true}});
  CHECK(box.lost().pictures == 4);  // what exceeds it first is taken
  CHECK(box.add_text("a notice"));
}

}  // namespace page_outbox_test
