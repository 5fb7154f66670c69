#include <catch2/catch.hpp>

#include "folder.h"
#include "sound_db/build/build_manifest.h"
#include "sound_db/build/speed_track.h"

namespace test_manifest {

using namespace rustle;
using namespace rustle::build;
using test::Folder;
using test::head;

namespace {

std::string all_of(const pack::Findings& findings) {
  std::string text;
  for (const auto& finding : findings) text += finding.what.text() + "\n";
  return text;
}

/// What is said of a manifest with this text.
std::string complaint(const std::string& manifest) {
  const Folder folder;
  folder.text("m.toml", manifest);
  pack::Findings findings;
  const auto read = read_build_manifest(folder / "m.toml", findings);
  CHECK(read.has_value() == findings.empty());
  return all_of(findings);
}

}  // namespace

TEST_CASE("The example manifest reads as it stands") {
  const Folder folder;
  folder.text("recordings.toml", example_manifest());
  pack::Findings findings;
  const auto manifest = read_build_manifest(folder / "recordings.toml", findings);
  INFO(all_of(findings));
  REQUIRE(manifest);
  CHECK(manifest->pack.material == "printer-paper");
  CHECK(manifest->pack.name == "printer-paper-on-wooden-table");
  CHECK(manifest->pack.friction->geometry.plane);
  CHECK_FALSE(manifest->pack.crumpling->geometry.plane);
  REQUIRE(manifest->takes.size() == 5);
  CHECK_FALSE(manifest->takes[0].point);
  CHECK(manifest->takes[1].from_s == 0.5);
  CHECK(manifest->takes[1].to_s == 9.5);
  CHECK(manifest->takes[1].session == "another day");
  CHECK(manifest->takes[2].point == pack::GridPoint{});
  CHECK_FALSE(manifest->takes[2].keep_levels);
  CHECK(manifest->takes[3].speed_m_per_s == 0.1);
  CHECK(manifest->takes[3].point == pack::GridPoint{0.1, 0.2});
  CHECK(manifest->takes[4].point == pack::GridPoint{});
  CHECK(manifest->takes[4].speed_track == "slides/flat_speed.csv");
}

TEST_CASE("What is wrong in a manifest is named with its line and a remedy") {
  const auto take = [](const std::string& lines) { return head() + "[[recording]]\nfiles = \"a.wav\"\n" + lines; };
  CHECK(complaint(take("class = \"clac\"\n")).empty());
  using Catch::Contains;
  CHECK_THAT(complaint("["), Contains("line 1") && Contains("--print-manifest"));
  CHECK_THAT(complaint(""), Contains("pack: is missing") && Contains("recording: is missing"));
  CHECK_THAT(complaint(take("")), Contains("class") && Contains("is missing"));
  CHECK_THAT(complaint(take("class = \"flop\"\n")), Contains("line 9") && Contains("flop") && Contains("crumple"));
  CHECK_THAT(complaint(take("class = \"clac\"\nl_r = 0.1\nl_c = 0.2\n")), Contains("constrained"));
  CHECK_THAT(complaint(take("class = \"flap\"\nl_r = 0.1\n")), Contains("must both be said"));
  CHECK_THAT(complaint(take("class = \"flap\"\nl_r = \"long\"\nl_c = 0.1\n")), Contains("line 10") && Contains("number"));
  CHECK_THAT(complaint(take("class = \"flap\"\nspeed = 0.1\n")), Contains("slides only"));
  CHECK_THAT(complaint(take("class = \"slide\"\nconstrained = true\n")), Contains("speed") && Contains("is missing"));
  CHECK_THAT(complaint(take("class = \"slide\"\nspeed = 1\nspeed_track = \"a.csv\"\n")), Contains("both said"));
  CHECK_THAT(complaint(take("class = \"clac\"\ntime = [2, 1]\n")), Contains("time = [0.5, 2.0]"));
  CHECK_THAT(complaint(take("class = \"clac\"\nvolume = 3\n")), Contains("volume") && Contains("is not known"));
  CHECK_THAT(complaint(take("class = \"clac\"\n[recording.geometry]\nplane = true\n")), Contains("compression"));
  CHECK_THAT(complaint(head("rate_hz = 48") + "[[recording]]\nfiles = []\nclass = \"clac\"\n"),
             Contains("rate_hz") && Contains("files"));
  pack::Findings findings;
  CHECK_FALSE(read_build_manifest("/nowhere/recordings.toml", findings));
  CHECK_THAT(all_of(findings), Contains("/nowhere/recordings.toml") && Contains("--print-manifest"));
}

TEST_CASE("Names and patterns find files, each part once") {
  const Folder folder;
  for (const char* name : {"a.wav", "flaps/one.wav", "flaps/two.wav", "flaps/deep/three.wav", "flaps/notes.txt"})
    folder.text(name, "x");
  const auto files = [&](const std::string& takes, pack::Findings& findings) {
    folder.text("m.toml", head() + takes);
    const auto manifest = read_build_manifest(folder / "m.toml", findings);
    REQUIRE(manifest);
    std::vector<std::string> names;
    for (const auto& file : files_of(*manifest, folder.path(), findings)) names.push_back(file.file);
    return names;
  };
  const auto take = [](const std::string& list, const std::string& more = "") {
    return "[[recording]]\nclass = \"clac\"\nfiles = " + list + "\n" + more;
  };
  using Names = std::vector<std::string>;
  pack::Findings findings;
  CHECK(files(take("[\"flaps/*.wav\", \"a.wav\"]"), findings) == Names{"flaps/one.wav", "flaps/two.wav", "a.wav"});
  CHECK(files(take("\"flaps/**/*.wav\""), findings) == Names{"flaps/deep/three.wav", "flaps/one.wav", "flaps/two.wav"});
  CHECK(files(take("\"**.wav\""), findings).size() == 4);
  CHECK(files(take("\"a.wav\"", "time = [0, 1]\n") + take("\"a.wav\"", "time = [1, 2]\n"), findings).size() == 2);
  CHECK(findings.empty());
  CHECK(files(take("\"a.wav\"", "time = [0, 1]\n") + take("\"*.wav\""), findings).size() == 2);
  CHECK_THAT(all_of(findings), Catch::Contains("a.wav, which recording[0]"));
  findings.clear();
  CHECK(files(take("\"b.wav\""), findings).empty());
  CHECK_THAT(all_of(findings), Catch::Contains("\"b.wav\" names no file"));
  findings.clear();
  CHECK(files(take("\"../a.wav\""), findings).empty());
  CHECK(findings.size() == 1);
}

TEST_CASE("A file's name may tell its place") {
  CHECK(point_in_name("flaps/r100_c200_1.wav") == pack::GridPoint{0.1, 0.2});
  CHECK(point_in_name("slide r025_c050.flac") == pack::GridPoint{0.025, 0.05});
  CHECK(point_in_name("r000_c000.wav") == pack::GridPoint{});
  CHECK(point_in_name("flat_2.wav") == pack::GridPoint{});
  for (const char* name : {"paper.wav", "r100.wav", "star100_c200.wav", "r0_c200.wav", "flattened.wav"})
    CHECK_FALSE(point_in_name(name));
}

TEST_CASE("Classes by the words of a path, the file's own first") {
  CHECK(guessed_class("kenney-rpg/bookFlip1.ogg") == SoundClass::kFlap);
  CHECK(guessed_class("old/page-turn.wav") == SoundClass::kFlap);
  CHECK(guessed_class("kenney-casino/card-slide-3.ogg") == SoundClass::kSlide);
  CHECK(guessed_class("card-shove-1.ogg") == SoundClass::kSlide);
  CHECK(guessed_class("card-fan-2.ogg") == SoundClass::kClac);
  CHECK(guessed_class("508597__drooler__crumple-06.ogg") == SoundClass::kCrumple);
  CHECK(guessed_class("paper-ripping.mp3") == SoundClass::kTear);
  CHECK(guessed_class("page tear.wav") == SoundClass::kTear);
  CHECK(guessed_class("cloth1.ogg") == SoundClass::kCloth);
  CHECK(guessed_class("slides/take3.wav") == SoundClass::kSlide);
  CHECK_FALSE(guessed_class("automat/canvas_pick.wav"));
  CHECK_FALSE(guessed_class("stripes/trip.wav"));
}

TEST_CASE("Speed tracks go straight between their points; a wrong line is named") {
  const Folder folder;
  folder.text("v.csv", "time_s,speed\n# from the encoder\n0.5, 0.1\n1.5,0.3\r\n\n2.5; -0.3\n");
  const auto track = read_speed_track(folder / "v.csv");
  REQUIRE(track);
  CHECK(track->at(0) == 0.1);
  CHECK(track->at(1.0) == Approx(0.2));
  CHECK(track->at(2.0) == Approx(0.3));
  CHECK(track->at(9) == 0.3);
  CHECK(track->fastest_m_per_s() == 0.3);
  const auto wrong = [&](const std::string& text) {
    folder.text("w.csv", text);
    const auto read = read_speed_track(folder / "w.csv");
    return read ? std::string() : read.error();
  };
  CHECK_THAT(wrong("0,1\n1,fast\n"), Catch::Contains("line 2"));
  CHECK_THAT(wrong("0,1\n0,2\n"), Catch::Contains("line 2") && Catch::Contains("does not follow"));
  CHECK_THAT(wrong("0 1\n"), Catch::Contains("line 1"));
  CHECK_THAT(wrong("0,nan\n"), Catch::Contains("line 1"));
  CHECK_THAT(wrong("# nothing\n"), Catch::Contains("no \"time,speed\""));
  CHECK_FALSE(read_speed_track(folder / "none.csv"));
}

}  // namespace test_manifest
