#include <stdlib.h>

#include <catch2/catch.hpp>
#include <set>

#include "sound_db/pack/library.h"
#include "sound_db/pack/query.h"
#include "sound_db/pack/write.h"
#include "tests/unit/pack/example_pack.h"

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
  library.rescan();
  CHECK(*library.load("card", "slate", 48000) != *a);
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
