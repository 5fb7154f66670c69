#include <catch2/catch.hpp>
#include <map>
#include <nlohmann/json.hpp>
#include <regex>
#include <sstream>
#include <string>

#include "server/monitor/health.h"
#include "server/monitor/json.h"
#include "server/monitor/metrics.h"
#include "server/monitor/monitor.h"

namespace figures_test {

namespace {

using namespace rustle;
using namespace rustle::monitor;

SessionFigures session(const std::string& id, std::uint64_t factor) {
  SessionFigures out;
  out.statistics.session_id = id;
  out.statistics.frames_received = 10 * factor;
  out.statistics.frames_analysed = 7 * factor;
  out.statistics.frames_dropped = {{"backlog", factor}, {"late " + id, factor}};
  out.statistics.samples_in_gaps = 4800 * factor;
  out.statistics.pcm_gaps = factor;
  out.statistics.voices = 2;
  out.frames_waiting = factor;
  out.rate_hz = 48000;
  out.live = true;
  session::DurationHistogram durations;
  for (std::uint64_t k = 0; k < factor; ++k) durations.add(std::chrono::microseconds(30));
  durations.add(std::chrono::seconds(5));
  out.stages.analysis = durations.counts();
  return out;
}

/// "name{labels}" to value; every line must be one that the format knows.
std::map<std::string, double> parse(const std::string& text) {
  static const std::regex comment("# (HELP|TYPE) [a-z_]+ .*");
  static const std::regex sample("([a-z_]+(?:\\{[^{}]*\\})?) (\\S+)");
  std::map<std::string, double> out;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::smatch match;
    INFO(line);
    if (std::regex_match(line, comment)) continue;
    REQUIRE(std::regex_match(line, match, sample));
    CHECK(out.emplace(match[1], std::stod(match[2])).second);
  }
  return out;
}

TEST_CASE("Metrics are sums over the sessions that are there and those that have gone, and each session's own") {
  DaemonFigures daemon;
  daemon.sessions = {session("a", 1), session("b", 2)};
  daemon.departed.add(session("gone", 4));
  const auto metrics = parse(metrics_text(daemon, {}));
  CHECK(metrics.at("rustle_sessions{clock=\"live\"}") == 2);
  CHECK(metrics.at("rustle_sessions_total") == 3);
  CHECK(metrics.at("rustle_frames_received_total") == 70);
  CHECK(metrics.at("rustle_frames_analysed_total") == 49);
  CHECK(metrics.at("rustle_frames_dropped_total{cause=\"backlog\"}") == 7);
  CHECK(metrics.at("rustle_frames_dropped_total{cause=\"late gone\"}") == 4);
  CHECK(metrics.at("rustle_frames_waiting") == 3);
  CHECK(metrics.at("rustle_voices") == 4);
  CHECK(metrics.at("rustle_pcm_gaps_total") == 7);
  CHECK(metrics.at("rustle_pcm_gap_seconds_total") == Approx(0.7));
  CHECK(metrics.at("rustle_session_frames_received_total{session=\"b\"}") == 20);
  CHECK(metrics.count("rustle_session_frames_received_total{session=\"gone\"}") == 0);
}

TEST_CASE("Histograms count up to the whole, and their last range has no end") {
  DaemonFigures daemon;
  daemon.sessions = {session("a", 3)};
  const auto metrics = parse(metrics_text(daemon, {}));
  const auto bucket = [&](const std::string& to) {
    return metrics.at("rustle_stage_seconds_bucket{stage=\"analysis\",le=\"" + to + "\"}");
  };
  CHECK(bucket("2.5e-05") == 0);
  CHECK(bucket("5e-05") == 3);
  CHECK(bucket("1") == 3);
  CHECK(bucket("+Inf") == 4);
  CHECK(metrics.at("rustle_stage_seconds_count{stage=\"analysis\"}") == 4);
  CHECK(metrics.at("rustle_stage_seconds_sum{stage=\"analysis\"}") == Approx(5.00009));
}

TEST_CASE("A session's id stands in metrics and JSON whatever it is made of") {
  DaemonFigures daemon;
  daemon.sessions = {session("a\"b\\c", 1)};
  const std::string text = metrics_text(daemon, {});
  CHECK(text.find("{session=\"a\\\"b\\\\c\"}") != std::string::npos);
  daemon.sessions = {session("\xff\xfe", 1)};
  const auto told = nlohmann::json::parse(figures_json(daemon, {}));
  CHECK(told["sessions"].size() == 1);
}

TEST_CASE("JSON tells every number of the statistics by its name") {
  DaemonFigures daemon;
  daemon.sessions = {session("a", 1)};
  daemon.departed.add(session("gone", 1));
  const auto told = nlohmann::json::parse(figures_json(daemon, {}));
  for (const auto& [name, value] : wire::numbers_of({})) CHECK(told["sessions"][0].contains(name));
  CHECK(told["totals"]["frames_received"] == 20);
  CHECK(told["totals"]["frames_dropped"]["backlog"] == 2);
  CHECK_FALSE(told["totals"].contains("playout_delay_s"));
}

TEST_CASE("Sums leave no counter out") {
  wire::Statistics each;
  std::size_t counted = 0;
  SessionFigures one = session("a", 1);
  for (auto member :
       {&wire::Statistics::messages_received, &wire::Statistics::messages_refused, &wire::Statistics::sequence_gaps,
        &wire::Statistics::samples_due, &wire::Statistics::samples_sent, &wire::Statistics::voices_stolen,
        &wire::Statistics::frames_late, &wire::Statistics::deadline_misses, &wire::Statistics::late_by_run_delay})
    one.statistics.*member = ++counted;
  Totals sums;
  sums.add(one);
  sums.add(one);
  CHECK(sums.statistics.messages_received == 2);
  CHECK(sums.statistics.late_by_run_delay == 2 * counted);
  CHECK(sums.statistics.voices_stolen == 12);
}

TEST_CASE("A daemon is unwell when it does not answer, ends, falls behind or stalls, and says which session does") {
  DaemonFigures daemon;
  daemon.sessions = {session("good", 1), session("bad", 1)};
  daemon.sessions[0].behind_s = kMostBehind_s / 2;
  daemon.sessions[0].analysis_stalled_s = kMostStalled_s / 2;
  CHECK(problems_of(&daemon).empty());
  CHECK(problems_of(nullptr).size() == 1);
  daemon.sessions[1].behind_s = 2 * kMostBehind_s;
  REQUIRE(problems_of(&daemon).size() == 1);
  CHECK_THAT(problems_of(&daemon).front(), Catch::Contains("bad") && Catch::Contains("not rendered"));
  daemon.sessions[1].behind_s = 0;
  daemon.sessions[1].analysis_stalled_s = 2 * kMostStalled_s;
  CHECK_THAT(problems_of(&daemon).at(0), Catch::Contains("bad") && Catch::Contains("analysis"));
  daemon.sessions.clear();
  daemon.draining = true;
  CHECK(problems_of(&daemon).size() == 1);
}

TEST_CASE("Traces are chosen by frame or message; stations that were not passed are null") {
  using session::Station;
  SessionTraces traces{"a", true, 1'000'000'000, {}};
  for (std::uint64_t k = 1; k <= 5; ++k) {
    session::FrameTrace trace;
    trace.frame = k;
    trace.sequence = 10 * k;
    trace.passed[static_cast<std::size_t>(Station::kReceived)] = std::chrono::milliseconds(100 * k);
    trace.passed[static_cast<std::size_t>(Station::kDecoded)] = std::chrono::milliseconds(100 * k + 1);
    if (k == 2) trace.dropped = "backlog";
    if (k == 3) {
      trace.delay_s = 0.04;
      trace.first_sample = 77;
      for (const auto station : {Station::kBegun, Station::kAnalysed, Station::kAccepted})
        trace.passed[static_cast<std::size_t>(station)] = std::chrono::milliseconds(302);
      trace.passed[static_cast<std::size_t>(Station::kSent)] = std::chrono::milliseconds(350);
    }
    traces.frames.push_back(trace);
  }
  const auto told = [&](const TraceChoice& choice) {
    return nlohmann::json::parse(trace_json(traces, choice, std::chrono::duration<double>(1000)))["frames"];
  };
  CHECK(told({}).size() == 5);
  const auto newest = told({{}, {}, 2});
  REQUIRE(newest.size() == 2);
  CHECK(newest[0]["frame"] == 4);
  CHECK(told({{}, 20, 32})[0]["dropped"] == "backlog");
  CHECK(told({9, {}, 32}).empty());
  const auto heard = told({3, {}, 32}).at(0);
  CHECK(heard["received_unix_s"].get<double>() == Approx(999.3));
  CHECK(heard["decoded_ms"].get<double>() == Approx(1));
  CHECK(heard["sent_ms"].get<double>() == Approx(50));
  CHECK(heard["beyond_delay_ms"].get<double>() == Approx(10));
  CHECK(heard["first_sample"] == 77);
  const auto waiting = told({1, {}, 32}).at(0);
  CHECK(waiting["begun_ms"].is_null());
  CHECK(waiting["first_sample"].is_null());
  CHECK(waiting["playout_delay_ms"].is_null());
}

}  // namespace

}  // namespace figures_test
