#include <catch2/catch.hpp>

#include <unistd.h>

#include <cstdlib>
#include <fstream>

#include "server/apps/configuration.h"
#include "server/apps/settings.h"

namespace settings_test {

using namespace rustle::apps;

namespace {

/// A file of settings that goes with the test.
class SettingsFile {
 public:
  explicit SettingsFile(const std::string& text) {
    char name[] = "/tmp/rustle-settings-XXXXXX";
    ::close(::mkstemp(name));
    path_ = name;
    std::ofstream(path_) << text;
  }
  ~SettingsFile() { std::filesystem::remove(path_); }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

const char* no_environment(const char*) {
  return nullptr;
}

struct Machine {
  int cups = 2;
  double heat = 90.5;
  bool milk = false;
  std::string bean = "arabica";
  std::string size = "small";
  std::vector<std::string> guests;
  std::uint32_t rate = 48000;
};

Settings settings_of_machine(Machine& machine) {
  Settings all("CAFE");
  all.section("brew", "How it is made");
  all.integer("brew.cups", "--cups", machine.cups, {1, 12}, "Cups at a time");
  all.reloadable();
  all.real("brew.heat", "--heat", machine.heat, {20, 98}, "Degrees");
  all.truth("brew.milk", "--milk", machine.milk, "With milk");
  all.section("order", "For whom");
  all.text("order.bean", "--bean", machine.bean, "What is ground", [](const std::string& value) {
    return value == "acorn" ? std::string("order.bean acorn: is no coffee; grind arabica") : std::string();
  });
  all.choice("order.size", "--size", machine.size, {"small", "large"}, "Which cup");
  all.texts("order.guests", "--guest", machine.guests, "Who drinks");
  all.number_of("order.rate", "--rate", machine.rate, {44100, 48000}, "Grinder's rate");
  return all;
}

}  // namespace

TEST_CASE("a setting may be said in a file, by a variable and by a flag, the later before the earlier", "[apps]") {
  Machine machine;
  Settings settings = settings_of_machine(machine);
  const SettingsFile file(
      "[brew]\ncups = 3\nheat = 91\nmilk = true\n[order]\nbean = \"robusta\"\nguests = [\"a\", \"b,c\"]\n");
  settings.give({{"--cups", {"5"}}});
  const auto errors = settings.read(file.path(), [](const char* name) -> const char* {
    if (std::string_view(name) == "CAFE_BREW_HEAT") return "92.5";
    if (std::string_view(name) == "CAFE_BREW_CUPS") return "4";
    return nullptr;
  });
  CHECK(errors.empty());
  CHECK(machine.cups == 5);
  CHECK(machine.heat == 92.5);
  CHECK(machine.milk);
  CHECK(machine.bean == "robusta");
  CHECK(machine.guests == std::vector<std::string>{"a", "b,c"});
  CHECK(machine.size == "small");
}

TEST_CASE("a list is separated by commas in a variable, and may be empty", "[apps]") {
  Machine machine;
  machine.guests = {"x"};
  Settings settings = settings_of_machine(machine);
  const auto say = [&](const char* text) {
    return settings.read(
        std::nullopt, [text](const char* name) { return std::string_view(name) == "CAFE_ORDER_GUESTS" ? text : nullptr; });
  };
  CHECK(say("a,b").empty());
  CHECK(machine.guests == std::vector<std::string>{"a", "b"});
  CHECK(say("").empty());
  CHECK(machine.guests.empty());
}

TEST_CASE("everything that is wrong is told at once, with its line and its mend", "[apps]") {
  Machine machine;
  Settings settings = settings_of_machine(machine);
  const SettingsFile file(
      "[brew]\n"
      "cups = 13\n"
      "heat = nan\n"
      "milk = 1\n"
      "coups = 3\n"
      "[order]\n"
      "bean = \"acorn\"\n"
      "size = \"huge\"\n"
      "guests = [\"a\", 2]\n"
      "rate = 48000.5\n"
      "[steam]\n"
      "x = 1\n");
  settings.give({{"--cups", {"2x"}}, {"--rate", {"96000"}}});
  const auto errors = settings.read(file.path(), no_environment);
  std::string all;
  for (const auto& error : errors) all += error.text() + "\n";
  INFO(all);
  CHECK(errors.size() == 11);
  const std::string name = file.path().string();
  for (const std::string& wanted : {
           name + ":2: brew.cups: 13 is not a whole number from 1 to 12",
           name + ":3: brew.heat: nan is not a number from 20 to 98",
           name + ":4: brew.milk: 1 is not true or false",
           name + ":5: brew.coups is not known; did you mean brew.cups?",
           name + ":7: order.bean acorn: is no coffee; grind arabica",
           name + ":8: order.size: 'huge' is not one of small, large",
           name + ":9: order.guests: [ 'a', 2 ] is not a list of texts",
           name + ":10: order.rate: 48000.5 is not one of 44100, 48000",
           name + ":11: there is no section [steam]; there are [brew], [order]",
           std::string("--cups: brew.cups: 2x is not a whole number"),
           std::string("--rate: order.rate: 96000 is not one of"),
       })
    CHECK(all.find(wanted) != std::string::npos);
  CHECK(machine.cups == 2);
  CHECK(machine.size == "small");
}

TEST_CASE("a file that is not there, or not TOML, is told", "[apps]") {
  Machine machine;
  Settings settings = settings_of_machine(machine);
  const auto absent = settings.read("/no/such/file.toml", no_environment);
  REQUIRE(absent.size() == 1);
  CHECK(absent[0].text().find("/no/such/file.toml") == 0);
  const auto folder = settings.read("/", no_environment);
  REQUIRE(folder.size() == 1);
  CHECK(folder[0].what.find("cannot be read") == 0);
  const SettingsFile broken("[brew]\ncups = = 3\n");
  const auto errors = settings.read(broken.path(), no_environment);
  REQUIRE(errors.size() == 1);
  CHECK(errors[0].where == broken.path().string() + ":2");
  for (const char* strange :
       {"[.brew]\n", "[brew]\rcups = 1\xC7\xA8\xD8\x8F\n", "[br\xC3\xA9w]\n", "[brew]\tmilk = \"\"\"\n\"\"\"\n",
        "[brew]\tmilk = +x\"\xC7\xA8\n", "[brew]\tmilk = '\xC3'\n", "[brew]\tmilk = '\xE2\x80'\n"}) {
    const SettingsFile file(strange);
    const auto told = settings.read(file.path(), no_environment);
    INFO(strange);
    REQUIRE(told.size() == 1);
    CHECK(told[0].where == file.path().string() + ":1");
  }
  const SettingsFile letters(
      "\xEF\xBB\xBF# caf\xC3\xA9 \xE2\x80\x83\n[order]\nguests = ['Zo\xC3\xAB', # \xC7\xA8\n \"Jos\\\"\xC3\xA9\", "
      "'C:\\\xF0\x9F\x98\x80\"']\n");
  CHECK(settings.read(letters.path(), no_environment).empty());
  CHECK(machine.guests == std::vector<std::string>{"Zo\xC3\xAB", "Jos\"\xC3\xA9", "C:\\\xF0\x9F\x98\x80\""});
}

TEST_CASE("what is printed says the same when it is read", "[apps]") {
  Machine machine{7, 33.3, true, "with \"quotes\" and \\", "large", {"a", "b\"c"}, 44100};
  const SettingsFile file(settings_of_machine(machine).print());
  Machine again;
  CHECK(settings_of_machine(again).read(file.path(), no_environment).empty());
  CHECK(again.cups == 7);
  CHECK(again.heat == 33.3);
  CHECK(again.milk);
  CHECK(again.bean == machine.bean);
  CHECK(again.size == "large");
  CHECK(again.guests == machine.guests);
  CHECK(again.rate == 44100);
}

TEST_CASE("changes tell what needs a new start", "[apps]") {
  Machine before, after;
  after.cups = 3;
  after.bean = "robusta";
  const auto changes = settings_of_machine(before).changes_to(settings_of_machine(after));
  CHECK(changes.reloadable == std::vector<std::string>{"brew.cups"});
  CHECK(changes.restart == std::vector<std::string>{"order.bean"});
}

TEST_CASE("the daemon's own settings read back as printed, and say what no endpoint may be", "[apps]") {
  Configuration configuration;
  const SettingsFile file(settings_of(configuration).print());
  Configuration again;
  Settings settings = settings_of(again);
  CHECK(settings.read(file.path(), no_environment).empty());
  CHECK(settings.changes_to(settings_of(configuration)).restart.empty());
  const SettingsFile open("[network]\ncontrol = \"udp://127.0.0.1:7390\"\n");
  const auto errors = settings.read(open.path(), no_environment);
  REQUIRE(errors.size() == 1);
  CHECK(errors[0].text().find(":2: network.control udp://127.0.0.1:7390: no endpoint") != std::string::npos);
}

}  // namespace settings_test
