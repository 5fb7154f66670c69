#include "server/report/html_report.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include "tests/unit/report/synthetic_input.h"

namespace rustle::report::html_report_test {
namespace {

std::size_t count(const std::string& text, std::string_view what) {
  std::size_t found = 0;
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) ++found;
  return found;
}

RenderReport full_report(const std::vector<float>& samples) {
  RenderReport report;
  report.title = "A <b>bold</b> & \"quoted\" title";
  report.capture = "captures/x<script>alert(1)</script>.mcap";
  report.duration_s = 1;
  report.mesh_frames = 60;
  report.sheets = {{1, "<i>sheet</i>", "paper", "printer-paper", 609, 1120}};
  report.seed = 42;
  report.mode = "corrected";
  report.load_s = 0.1;
  report.render_s = 0.5;
  report.sound = {samples, 2, 48000, 0};
  report.limited_samples = 1234;
  report.limit_db = -1;
  for (std::uint64_t id = 1; id <= 25; ++id)
    report.events.push_back(crumple(id, 0.03 * static_cast<double>(id), 0.01 * static_cast<double>(id)));
  report.events.push_back(rub(26, 0.2, 0.7, 0.15));
  for (EventMark& event : report.events) event.sheet = 1;
  report.pack_grid = {{0, 0}, {0.1, 0.2}, {0.3, 0.6}};
  report.facts = {{"Listener", "1 m & 30 degrees"}};
  report.notices = {"<coarse>"};
  return report;
}

/// Every start tag has its end, in order.
void check_balanced(const std::string& page) {
  std::vector<std::string> open;
  for (std::size_t at = page.find('<'); at != std::string::npos; at = page.find('<', at + 1)) {
    const std::string tag = page.substr(at + 1, page.find('>', at) - at - 1);
    const bool end = tag.front() == '/';
    const std::string name = tag.substr(end ? 1 : 0, tag.find_first_of(" \n", 1) - (end ? 1 : 0));
    if (name == "meta" || name.front() == '!' || tag.back() == '/') continue;
    if (!end) {
      open.push_back(name);
    } else {
      REQUIRE_FALSE(open.empty());
      REQUIRE(open.back() == name);
      open.pop_back();
    }
  }
  CHECK(open.empty());
}

/// The values of every attribute of a name.
std::vector<std::string> attributes(const std::string& page, const std::string& name) {
  std::vector<std::string> values;
  const std::string start = " " + name + "=\"";
  for (std::size_t at = page.find(start); at != std::string::npos; at = page.find(start, at + 1)) {
    const std::size_t from = at + start.size();
    values.push_back(page.substr(from, page.find('"', from) - from));
  }
  return values;
}

/// Pictures' data hold any letters.
std::string without_pictures(std::string page) {
  for (std::size_t at = page.find("base64,"); at != std::string::npos; at = page.find("base64,", at + 7)) {
    page.erase(at + 7, page.find('"', at) - at - 7);
  }
  return page;
}

}  // namespace

TEST_CASE("the page needs nothing but itself") {
  const std::vector<float> samples = tone(1000, 0.4, 1, 48000, 2);
  const std::string page = without_pictures(html_report(full_report(samples)));
  for (const std::string_view outside :
       {"http:", "https:", "src=", "<script", "<link", "@import", "url(http", "<iframe", "<base"}) {
    INFO(outside);
    CHECK(page.find(outside) == std::string::npos);
  }
  CHECK(count(page, "href=") == count(page, "href=\"data:image/png;base64,"));
  CHECK(count(page, "href=") >= 2);
  CHECK(count(page, "url(") == count(page, "url(#"));
  CHECK(page.find("prefers-color-scheme:dark") != std::string::npos);
  CHECK(page.find("name=\"viewport\"") != std::string::npos);
  check_balanced(page);
}

TEST_CASE("what comes from outside is escaped") {
  const std::string page = html_report(full_report(tone(1000, 0.4, 0.1, 48000, 2)));
  CHECK(page.find("<b>bold") == std::string::npos);
  CHECK(page.find("<i>sheet") == std::string::npos);
  CHECK(page.find("alert(1)</script") == std::string::npos);
  CHECK(page.find("A &lt;b&gt;bold&lt;/b&gt; &amp; &quot;quoted&quot; title") != std::string::npos);
  CHECK(page.find("&lt;coarse&gt;") != std::string::npos);
}

TEST_CASE("the page says the numbers, and every picture and table is described") {
  const std::vector<float> samples = tone(1000, 0.5, 1, 48000, 2);
  const std::string page = without_pictures(html_report(full_report(samples)));
  for (const std::string_view text : {"<b>25</b>", "<b>-6.0</b>", "<b>-9.0</b>", "0 / 1,234", "printer-paper",
                                      "48000 Hz, stereo", "corrected", "<dd>42</dd>", "2.00 x real time", "1,120"}) {
    INFO(text);
    CHECK(page.find(text) != std::string::npos);
  }
  CHECK(count(page, "<svg ") == count(page, "role=\"img\" aria-label=\""));
  CHECK(count(page, "<svg ") >= 6);
  CHECK(count(page, "<table>") == count(page, "<thead>"));
  CHECK(count(page, "<th scope=") == count(page, "<th "));
  CHECK(count(page, "<th scope=\"row\">") == 10);

  std::vector<std::string> ids = attributes(page, "id");
  CHECK(ids.size() >= 2);
  std::sort(ids.begin(), ids.end());
  CHECK(std::adjacent_find(ids.begin(), ids.end()) == ids.end());
}

TEST_CASE("the same report gives the same bytes") {
  const std::vector<float> samples = tone(700, 0.4, 0.3, 48000, 2);
  CHECK(html_report(full_report(samples)) == html_report(full_report(samples)));
}

TEST_CASE("an empty report and one of odd numbers are whole pages") {
  RenderReport odd;
  odd.duration_s = std::numeric_limits<double>::quiet_NaN();
  const std::vector<float> bad(960, std::numeric_limits<float>::quiet_NaN());
  odd.sound = {bad, 1, 48000, 0};
  odd.events = {crumple(1, std::numeric_limits<double>::infinity(), std::numeric_limits<double>::quiet_NaN())};
  for (const RenderReport& report : {RenderReport{}, odd}) {
    const std::string page = without_pictures(html_report(report));
    CHECK(page.find("</html>") != std::string::npos);
    for (const std::string name : {"x", "y", "d", "cx", "cy", "r", "width", "height"}) {
      for (const std::string& value : attributes(page, name)) {
        CHECK(value.find("nan") == std::string::npos);
        CHECK(value.find("inf") == std::string::npos);
      }
    }
    check_balanced(page);
  }
  CHECK(html_report({}).find("There are no events.") != std::string::npos);
  CHECK(html_report(odd).find("960 samples are not finite") != std::string::npos);
}

TEST_CASE("a report is written as it was made, or the error names the file") {
  const auto path = std::filesystem::temp_directory_path() / "rustle_report_test.html";
  REQUIRE(write_html_report(path, {}));
  std::ifstream file(path, std::ios::binary);
  const std::string written{std::istreambuf_iterator<char>(file), {}};
  CHECK(written == html_report({}));
  std::filesystem::remove(path);
  const auto refused = write_html_report("/nowhere/report.html", {});
  REQUIRE_FALSE(refused);
  CHECK(refused.error().find("/nowhere/report.html") != std::string::npos);
}

}  // namespace rustle::report::html_report_test
