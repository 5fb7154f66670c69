#pragma once

#include <ctime>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

/// What the benchmarks share: options, timing on one thread, rows on standard output, goals.
namespace rustle::bench {

struct Options {
  bool json = false;   ///< one JSON object per row instead of a table
  bool check = false;  ///< a missed goal makes the exit status 1
  int frames = 300;    ///< timed, after the discarded ones
  int triangles = 0;   ///< only this size, where a benchmark goes through several; 0: all
};

/// Ends the program with status 2 and a sentence on wrong usage.
inline Options read_options(int argc, char** argv) {
  Options options;
  const auto refuse = [](std::string_view why) {
    fmt::print(stderr, "{}; usage: [--json] [--check] [--frames N] [--triangles N]\n", why);
    std::exit(2);
  };
  for (int k = 1; k < argc; ++k) {
    const std::string_view argument = argv[k];
    if (argument == "--json") {
      options.json = true;
    } else if (argument == "--check") {
      options.check = true;
    } else if (argument == "--frames") {
      options.frames = k + 1 < argc ? std::atoi(argv[++k]) : 0;
      if (options.frames < 1) refuse("--frames wants a number of at least 1");
    } else if (argument == "--triangles") {
      options.triangles = k + 1 < argc ? std::atoi(argv[++k]) : 0;
      if (options.triangles < 1) refuse("--triangles wants a number of at least 1");
    } else {
      refuse(fmt::format("unknown argument '{}'", argument));
    }
  }
  return options;
}

/// Time this thread has computed, in µs: unlike the wall's clock it does not run while other programs have the core.
inline double thread_time_us() {
  std::timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) * 1e6 + static_cast<double>(now.tv_nsec) * 1e-3;
}

/// Runs of one piece of work.
class Timings {
 public:
  template <class Work>
  void run(Work&& work) {
    const double start = thread_time_us();
    work();
    times_us_.push_back(thread_time_us() - start);
  }

  /// A time taken otherwise.
  void add(double time_us) { times_us_.push_back(time_us); }
  void discard() { times_us_.clear(); }
  bool empty() const { return times_us_.empty(); }

  double quantile_us(double share) const {
    if (times_us_.empty()) return std::numeric_limits<double>::quiet_NaN();
    std::vector<double> sorted = times_us_;
    const auto at = static_cast<std::size_t>(share * static_cast<double>(sorted.size() - 1) + 0.5);
    std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(at), sorted.end());
    return sorted[at];
  }
  double median_us() const { return quantile_us(0.5); }
  double mean_us() const {
    double sum = 0;
    for (const double time : times_us_) sum += time;
    return sum / static_cast<double>(times_us_.size());
  }

 private:
  std::vector<double> times_us_;
};

struct Row {
  std::string name;
  std::size_t count = 0;
  double median_us = 0;
  double p95_us = 0;
  double reference_us = std::numeric_limits<double>::quiet_NaN();  ///< median of the reference, run in turn with it
  std::string counted = "triangles";
  double mean_us = std::numeric_limits<double>::quiet_NaN();

  double ratio() const { return median_us / reference_us; }
};

/// Rows on standard output; goals at the end: in the table below it, with JSON on standard error.
class Report {
 public:
  explicit Report(const Options& options) : options_(options) {
    if (!options.json)
      fmt::print("{:24}{:>10}{:>12}{:>12}{:>14}{:>8}{:>12}\n", "", "count", "median us", "p95 us", "reference us", "ratio",
                 "mean us");
  }

  void add(const Row& row) {
    if (options_.json) {
      const nlohmann::ordered_json line = {{"name", row.name},
                                           {row.counted, row.count},
                                           {"median_us", rounded(row.median_us)},
                                           {"reference_us", rounded(row.reference_us)},
                                           {"ratio", rounded(row.ratio())},
                                           {"p95_us", rounded(row.p95_us)},
                                           {"mean_us", rounded(row.mean_us)}};
      fmt::print("{}\n", line.dump());
    } else {
      fmt::print("{:24}{:>10}{:>12.1f}{:>12.1f}", row.name, row.count, row.median_us, row.p95_us);
      if (std::isfinite(row.reference_us)) fmt::print("{:>14.1f}{:>8.2f}", row.reference_us, row.ratio());
      if (std::isfinite(row.mean_us)) fmt::print("{:>12.1f}", row.mean_us);
      fmt::print("\n");
    }
    std::fflush(stdout);
  }

  void note(std::string_view text) const { fmt::print(options_.json ? stderr : stdout, "  {}\n", text); }

  void goal(std::string_view what, double value, double at_most) { goal(what, value, at_most, value <= at_most); }
  /// A goal that wants at least so much. What is not a number has not been shown.
  void goal_at_least(std::string_view what, double value, double at_least) {
    goal(what, value, at_least, value >= at_least);
  }

  /// The program's exit status.
  [[nodiscard]] int finish() const { return options_.check && missed_ > 0 ? 1 : 0; }

 private:
  void goal(std::string_view what, double value, double bound, bool met) {
    missed_ += met ? 0 : 1;
    fmt::print(options_.json ? stderr : stdout, "{:6} {:44}{:>10.2f}   goal {:g}\n", met ? "met" : "MISSED", what, value,
               bound);
  }
  static double rounded(double value) { return std::round(value * 1000) / 1000; }

  Options options_;
  int missed_ = 0;
};

}  // namespace rustle::bench
