#include <stdlib.h>

#include <atomic>
#include <catch2/catch.hpp>
#include <chrono>
#include <future>
#include <set>

#include "sound_db/pack/library.h"
#include "sound_db/pack/query.h"
#include "sound_db/pack/write.h"
#include "tests/unit/pack/example_pack.h"

namespace test_query {

using namespace rustle;
using namespace rustle::pack;
using Catch::Matchers::Contains;

TEST_CASE("the nearest grid point is found in (l_r, l_c/2); the constrained sounds only for the constrained") {
  const SoundPack pack = example_pack();
  const auto& friction = *pack.friction;
  CHECK(nearest_spectrum(friction, {0.06, 0.12})->point == GridPoint{0.05, 0.1});
  CHECK(nearest_spectrum(friction, {9, 9})->point == GridPoint{0.1, 0.2});
  // 3 cm off in l_r and 3 cm in l_c/2 from both: a hair decides.
  CHECK(nearest_spectrum(friction, {0.08, 0.1401})->point == GridPoint{0.1, 0.2});
  CHECK(nearest_spectrum(friction, {0.001, 0.001})->point == GridPoint{0.05, 0.1});
  CHECK(nearest_spectrum(friction, {})->point.constrained());
  CHECK(nearest_spectrum(friction, {0.1, 0})->point.constrained());
  CHECK(nearest_variants(*pack.crumpling, {0.11, 0.2}) == std::vector<std::uint32_t>{4, 5});
  CHECK(nearest_variants(*pack.crumpling, {}) == std::vector<std::uint32_t>{0, 1});
  CHECK(nearest_variants({}, {}).empty());
  CHECK(nearest_spectrum({}, {}) == nullptr);
}

TEST_CASE("no variant sounds twice running, all sound equally often, and one alone repeats") {
  const std::vector<std::uint32_t> variants{7, 8, 9};
  dsp::Random random(1);
  std::uint32_t last = kNoUnit;
  std::map<std::uint32_t, int> counts;
  for (int i = 0; i < 30000; ++i) {
    const auto unit = choose_variant(variants, random.uniform(), last);
    REQUIRE(unit != last);
    ++counts[unit];
    last = unit;
  }
  REQUIRE(counts.size() == 3);
  for (const auto& [unit, count] : counts) CHECK(count == Approx(10000).epsilon(0.05));
  CHECK(choose_variant({5}, 0.9, 5) == 5);
  CHECK(choose_variant({}, 0.9, 5) == kNoUnit);
  CHECK(choose_variant(variants, 1.0, kNoUnit) == 9);
}

TEST_CASE("a library finds packs by material and surface, in search order, and shares what it loads") {
  const TemporaryFolder first, second;
  SoundPack vellum = example_pack();
  REQUIRE(write(vellum, second.path() / "vellum"));
  vellum.version = "0.2";
  REQUIRE(write(vellum, first.path() / "vellum"));
  vellum.touched_surface = "wool";
  REQUIRE(write(vellum, first.path() / "vellum-on-wool"));
  SoundPack card = example_pack();
  card.material = "card";
  REQUIRE(write(card, second.path() / "card"));
  std::filesystem::create_directory(second.path() / "broken");
  write_bytes(second.path() / "broken/pack.json", "{");

  PackLibrary library({first.path(), second.path(), second.path() / "nowhere"});
  CHECK(library.materials() == std::vector<std::string>{"card", "vellum"});
  CHECK(library.entries().size() == 4);
  CHECK(library.broken().size() == 1);
  CHECK(library.find("vellum", "slate")->version == "0.2");
  CHECK(library.find("vellum", "wool")->touched_surface == "wool");
  CHECK(library.find("vellum", "glass")->touched_surface == "slate");

  const auto missing = library.load("parchment", "slate", 48000);
  REQUIRE_FALSE(missing);
  CHECK_THAT(missing.error().text(), Contains("parchment") && Contains("card, vellum") && Contains("broken"));
  const auto none = PackLibrary(std::vector<std::filesystem::path>{}).find("vellum");
  REQUIRE_FALSE(none);
  CHECK_THAT(none.error().text(), Contains("rustle pack generate"));

  const auto a = library.load("card", "slate", 48000), b = library.load("card", "slate", 48000);
  const auto c = library.load("card", "slate", 44100);
  REQUIRE((a && b && c));
  CHECK(*a == *b);
  CHECK(*a != *c);
}

namespace {

/// Two packs in a folder, and a library that has loaded both.
struct Shelf {
  TemporaryFolder folder;
  SoundPack vellum = example_pack(), card = example_pack();
  std::unique_ptr<PackLibrary> library;
  std::shared_ptr<const SoundPack> old_vellum, old_card;

  Shelf() {
    vellum.name = vellum.material = "vellum";
    card.name = "card-on-slate";
    card.material = "card";
    put(vellum);
    put(card);
    library = std::make_unique<PackLibrary>(std::vector{folder.path()});
    old_vellum = now("vellum");
    old_card = now("card");
  }
  std::filesystem::path place(const std::string& material) const { return folder.path() / material; }
  void put(const SoundPack& pack) const {
    std::filesystem::remove_all(place(pack.material));
    REQUIRE(write(pack, place(pack.material)));
  }
  std::shared_ptr<const SoundPack> now(const std::string& material) const {
    return library->load(material, {}, 48000).value();
  }
  bool all_as_it_was() const {
    return now("vellum") == old_vellum && now("card") == old_card && library->entries().size() == 2;
  }
};

}  // namespace

TEST_CASE("packs are read anew when asked to, and those that read the same stay shared") {
  Shelf shelf;
  const auto other_rate = shelf.library->load("vellum", {}, 44100).value();
  shelf.vellum.version = "0.2";
  shelf.put(shelf.vellum);
  CHECK(shelf.all_as_it_was());
  const auto read = shelf.library->reload("", 48000);
  REQUIRE(read);
  REQUIRE(read->size() == 2);
  CHECK(shelf.now("card") == shelf.old_card);
  CHECK(shelf.now("vellum")->version == "0.2");
  CHECK(std::count(read->begin(), read->end(), shelf.now("vellum")) == 1);
  CHECK(shelf.old_vellum->version == "0.1");
  CHECK(shelf.library->load("vellum", {}, 44100).value() != other_rate);
  CHECK(shelf.library->find("vellum")->version == "0.2");
}

TEST_CASE("a pack is read anew by its name, and new ones are found") {
  Shelf shelf;
  shelf.vellum.version = shelf.card.version = "0.2";
  shelf.put(shelf.vellum);
  shelf.put(shelf.card);
  REQUIRE(shelf.library->reload("card-on-slate", 48000)->size() == 1);
  CHECK(shelf.now("card")->version == "0.2");
  CHECK(shelf.now("vellum") == shelf.old_vellum);
  SoundPack silk = example_pack();
  silk.name = silk.material = "silk";
  shelf.put(silk);
  CHECK_FALSE(shelf.library->find("silk"));
  REQUIRE(shelf.library->reload("silk", 48000));
  CHECK(shelf.now("silk")->material == "silk");
  CHECK(shelf.now("vellum") == shelf.old_vellum);
  std::vector<std::string> order;
  for (const auto& entry : shelf.library->entries()) order.push_back(entry.name);
  CHECK(order == std::vector<std::string>{"card-on-slate", "silk", "vellum"});
  std::filesystem::remove_all(shelf.place("silk"));
  REQUIRE(shelf.library->reload("", 48000));
  CHECK_FALSE(shelf.library->find("silk"));
}

TEST_CASE("where a pack cannot be read anew its file is named, and everything stays as it was") {
  Shelf shelf;
  shelf.vellum.version = "0.2";
  shelf.put(shelf.vellum);
  const auto refused = [&](const std::string& name) {
    const auto read = shelf.library->reload(name, 48000);
    REQUIRE_FALSE(read);
    CHECK(shelf.all_as_it_was());
    return read.error().text();
  };
  SECTION("a unit") {
    write_bytes(shelf.place("card") / "units/3.wav", "RIFF");
    for (const char* name : {"", "card", "card-on-slate"}) CHECK_THAT(refused(name), Contains("card/units/3.wav"));
    CHECK(shelf.library->reload("vellum", 48000));
  }
  SECTION("a manifest") {
    write_bytes(shelf.place("card") / "pack.json", "{");
    for (const char* name : {"", "card"}) CHECK_THAT(refused(name), Contains("card/pack.json"));
    REQUIRE(shelf.library->reload("vellum", 48000));
    CHECK(shelf.now("card") == shelf.old_card);
    shelf.put(shelf.card);
    CHECK(shelf.library->reload("card", 48000));
  }
  SECTION("one that was never there") {
    std::filesystem::create_directory(shelf.place("silk"));
    write_bytes(shelf.place("silk") / "pack.json", "[");
    for (const char* name : {"", "silk"}) CHECK_THAT(refused(name), Contains("silk/pack.json"));
    CHECK_THAT(refused("parchment"), Contains("parchment") && Contains("card, vellum"));
  }
  SECTION("none at all") {
    std::filesystem::remove_all(shelf.place("card"));
    std::filesystem::remove_all(shelf.place("vellum"));
    CHECK_FALSE(shelf.library->reload("", 48000));
    CHECK(shelf.now("card") == shelf.old_card);
  }
}

TEST_CASE("RUSTLE_PACK_PATH comes first, the program's own share folder next") {
  ::setenv("RUSTLE_PACK_PATH", "/a::/b", 1);
  const auto folders = default_search_folders();
  ::unsetenv("RUSTLE_PACK_PATH");
  REQUIRE(folders.size() == 4);
  CHECK(folders[0] == "/a");
  CHECK(folders[1] == "/b");
  CHECK_THAT(folders[2].string(), Catch::Matchers::EndsWith("/share/rustle/packs"));
  CHECK(folders[3] == "/usr/share/rustle/packs");
}

TEST_CASE("a pack is read once for all who ask, and nobody else waits for it") {
  const TemporaryFolder folder;
  SoundPack second = example_pack();
  second.material = "parchment";
  REQUIRE(write(example_pack(), folder.path() / "a"));
  REQUIRE(write(second, folder.path() / "b"));
  std::atomic<int> reads{0};
  std::promise<void> begun, go_on;
  const std::shared_future<void> may_go_on = go_on.get_future().share();
  PackLibrary packs({folder.path()}, [&](const std::filesystem::path& pack, const LoadOptions& options) {
    ++reads;
    if (pack.filename() == "a") {
      if (options.rate_hz == 48000) begun.set_value();
      may_go_on.wait();
    }
    return load(pack, options);
  });
  const auto ask = [&](const char* material, std::uint32_t rate_hz) {
    return std::async(std::launch::async, [&packs, material, rate_hz] { return packs.load(material, {}, rate_hz); });
  };
  auto first = ask("vellum", 48000);
  begun.get_future().wait();
  auto same = ask("vellum", 48000);
  // Who waits for the first read would wait for ever.
  auto other = ask("parchment", 48000);
  auto found = std::async(std::launch::async, [&packs] { return packs.find("vellum"); });
  const auto comes = [](auto& future) { return future.wait_for(std::chrono::seconds(20)) == std::future_status::ready; };
  CHECK(comes(other));
  CHECK(comes(found));
  CHECK(same.wait_for(std::chrono::milliseconds(50)) == std::future_status::timeout);
  go_on.set_value();
  const auto a = first.get(), b = same.get();
  REQUIRE(a);
  REQUIRE(b);
  CHECK(a->get() == b->get());
  CHECK(other.get());
  CHECK(reads == 2);
}

TEST_CASE("a pack that could not be read is read again when asked for again") {
  const TemporaryFolder folder;
  REQUIRE(write(example_pack(), folder.path() / "a"));
  int reads = 0;
  PackLibrary packs({folder.path()}, [&](const std::filesystem::path& pack, const LoadOptions& options) {
    if (++reads == 1) return PackLibrary::Result(tl::unexpected(PackError{pack.string(), "", "is away", "wait"}));
    return load(pack, options);
  });
  CHECK_FALSE(packs.load("vellum", {}, 48000));
  CHECK(packs.load("vellum", {}, 48000));
}

}  // namespace test_query
