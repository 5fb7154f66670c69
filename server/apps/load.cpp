#include "server/apps/load.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <memory>
#include <mutex>
#include <queue>
#include <thread>
#include <utility>

#include "server/apps/command.h"
#include "server/apps/load_client.h"

namespace rustle::apps {
namespace {

using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;
using Time = LoadClient::Time;

constexpr double kWarmUp_s = 1;
constexpr double kComesBack_s = 1;                  // after one vanished, the next
constexpr double kHeard_ms = 20;                    // beyond the playout delay, for sustained()
constexpr std::chrono::milliseconds kThrough{300};  // until the daemon is through with what was sent

double quantile(std::vector<float>& values, double share) {
  if (values.empty()) return 0;
  const auto at = static_cast<std::size_t>(share * static_cast<double>(values.size() - 1) + 0.5);
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(at), values.end());
  return static_cast<double>(values[at]);
}

/// The clients of one crowd, and what those that left have told.
class Crowd {
 public:
  static tl::expected<std::unique_ptr<Crowd>, std::string> make(const LoadCrowd& crowd, const LoadOptions& options,
                                                                const std::string& name) {
    auto made = std::unique_ptr<Crowd>(new Crowd(crowd, options, name));
    std::vector<std::string> names = crowd.sheets;
    if (names.empty()) names = {"crumple", "slide"};
    for (const std::string& sheet : names) {
      // What comes more often than 240 times a second is a motion that is faster.
      auto loop = sheets::make_loop(sheet, crowd.triangles, std::min(crowd.frames_per_s, 240.0), options.seed);
      if (!loop) return tl::unexpected(fmt::format("there is no sheet \"{}\"", sheet));
      made->loops_.push_back(std::make_shared<const sheets::Loop>(std::move(*loop)));
    }
    return made;
  }

  tl::expected<void, client::Error> add(const client::Connection& connection) {
    const std::size_t number = added_++;
    LoadPlan plan;
    plan.loop = loops_[number % loops_.size()];
    plan.phase = number * 7;
    plan.frames_per_s = crowd_.frames_per_s;
    plan.jitter_s = options_.jitter_s;
    plan.withheld = options_.withheld;
    plan.playout_delay_s = options_.playout_delay_s;
    plan.blocks = options_.blocks;
    plan.material = options_.material;
    plan.seed = options_.seed + number;
    auto client = LoadClient::attach(connection, fmt::format("{}-{}", name_, number), std::move(plan));
    if (!client) return tl::unexpected(client.error());
    clients.push_back(std::move(*client));
    return {};
  }

  /// Those that have not begun begin, not all at the same moment of a frame's interval.
  void begin(Time start) {
    for (; begun_ < clients.size(); ++begun_) {
      const double apart_s = std::fmod(0.618034 * static_cast<double>(added_ - begun_), 1.0) / crowd_.frames_per_s;
      clients[begun_]->begin(later(start, apart_s));
    }
  }

  /// One client is gone; what the daemon knows of it is told.
  void lose(const client::Connection& connection, std::size_t which) {
    auto lost = std::move(clients[which]);
    clients.erase(clients.begin() + static_cast<std::ptrdiff_t>(which));
    --begun_;
    const std::string id = lost->id();
    lost->vanish();
    std::this_thread::sleep_for(kThrough);
    take(lost->take_figures(), connection.statistics(id));
  }

  CrowdFigures finish() {
    for (auto& client : clients) {
      const auto statistics = client->detach();
      take(client->take_figures(), statistics);
    }
    figures_.sessions = clients.size();
    figures_.latency = {1e3 * quantile(latency_s_, 0.5), 1e3 * quantile(latency_s_, 0.99),
                        1e3 * quantile(latency_s_, 0.999)};
    figures_.send_late_p99_ms = 1e3 * quantile(late_s_, 0.99);
    return figures_;
  }

  std::vector<std::unique_ptr<LoadClient>> clients;

 private:
  Crowd(LoadCrowd crowd, const LoadOptions& options, std::string name)
      : crowd_(std::move(crowd)), options_(options), name_(std::move(name)) {}

  void take(LoadClient::Figures seen, const tl::expected<client::Statistics, client::Error>& told) {
    latency_s_.insert(latency_s_.end(), seen.latency_s.begin(), seen.latency_s.end());
    late_s_.insert(late_s_.end(), seen.late_s.begin(), seen.late_s.end());
    figures_.frames_sent += seen.frames_sent;
    figures_.pcm_gaps += seen.pcm_gaps;
    figures_.longest_silence_s = std::max(figures_.longest_silence_s, seen.longest_silence_s);
    if (!told) {
      figures_.sums_exact = false;
      return;
    }
    std::uint64_t dropped = 0;
    for (const auto& [cause, count] : told->frames_dropped) {
      figures_.dropped[cause] += count;
      dropped += count;
    }
    figures_.playout_delay_s = std::max(figures_.playout_delay_s, told->playout_delay_s);
    figures_.frames_received += told->frames_received;
    figures_.frames_analysed += told->frames_analysed;
    figures_.deadline_misses += told->deadline_misses;
    figures_.late_by_run_delay += told->late_by_run_delay;
    const bool whole = told->sequence_gaps > 0 || seen.frames_sent == told->frames_received;
    figures_.sums_exact = figures_.sums_exact && whole && told->frames_received == told->frames_analysed + dropped;
  }

  const LoadCrowd crowd_;
  const LoadOptions& options_;
  const std::string name_;
  std::vector<std::shared_ptr<const sheets::Loop>> loops_;
  std::size_t added_ = 0, begun_ = 0;
  CrowdFigures figures_;
  std::vector<float> latency_s_, late_s_;
};

/// Two threads that work for all clients, held while clients come and go.
class Players {
 public:
  Players(std::vector<Crowd*> crowds, const LoadOptions& options, Time start)
      : crowds_(std::move(crowds)), options_(options), start_(start) {}
  ~Players() { stop(); }

  void start() {
    stop_ = false;
    sender_ = std::thread([this] { send(); });
    listener_ = std::thread([this] { listen(); });
  }
  void stop() {
    stop_ = true;
    if (sender_.joinable()) sender_.join();
    if (listener_.joinable()) listener_.join();
  }
  /// Why a client could no longer send. [control, while stopped]
  const std::optional<client::Error>& failed() const { return failed_; }

 private:
  void send() {
    struct Due {
      Time at;
      LoadClient* client;
      bool operator>(const Due& other) const { return at > other.at; }
    };
    std::priority_queue<Due, std::vector<Due>, std::greater<>> due;
    for (Crowd* crowd : crowds_) {
      for (auto& client : crowd->clients) due.push({client->due(), client.get()});
    }
    while (!stop_ && !due.empty()) {
      const Due next = due.top();
      const Time now = Clock::now();
      if (next.at > now) {
        std::this_thread::sleep_until(std::min(next.at, now + std::chrono::milliseconds(20)));
        continue;
      }
      due.pop();
      if (const auto sent = next.client->send(speed(now)); !sent) {
        failed_ = sent.error();
        return;
      }
      due.push({next.client->due(), next.client});
    }
  }

  double speed(Time now) const {
    if (!options_.surge) return 1;
    const double time_s = Seconds(now - start_).count() - kWarmUp_s;
    return time_s >= options_.surge->from_s && time_s < options_.surge->to_s ? options_.surge->times : 1;
  }

  void listen() {
    while (!stop_) {
      bool any = false;
      for (Crowd* crowd : crowds_) {
        for (auto& client : crowd->clients) any = client->listen() || any;
      }
      if (!any) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }

  const std::vector<Crowd*> crowds_;
  const LoadOptions& options_;
  const Time start_;
  std::atomic<bool> stop_{true};
  std::thread sender_, listener_;
  std::optional<client::Error> failed_;  // sender
};

}  // namespace

tl::expected<LoadFigures, std::string> run_load(const client::Connection& connection, const LoadOptions& options,
                                                const std::function<void(double share)>& progress) {
  auto made = Crowd::make(options.crowd, options, "load");
  if (!made) return tl::unexpected(made.error());
  std::vector<std::unique_ptr<Crowd>> crowds;
  crowds.push_back(std::move(*made));
  if (options.heavy) {
    made = Crowd::make(*options.heavy, options, "heavy");
    if (!made) return tl::unexpected(made.error());
    crowds.push_back(std::move(*made));
  }
  LoadFigures out;
  const auto fill = [&](Crowd& crowd, std::size_t sessions) -> tl::expected<void, std::string> {
    for (std::size_t k = 0; k < sessions; ++k) {
      const auto added = crowd.add(connection);
      if (!added && client::kind_of(added.error()) != client::ErrorKind::kRefused)
        return tl::unexpected(client::to_string(added.error()));
      if (!added) ++out.refused;
      progress(0.1 * static_cast<double>(k) / static_cast<double>(sessions));
    }
    return {};
  };
  if (auto filled = fill(*crowds.front(), options.crowd.sessions); !filled) return tl::unexpected(filled.error());
  if (options.heavy) {
    if (auto filled = fill(*crowds.back(), options.heavy->sessions); !filled) return tl::unexpected(filled.error());
  }

  std::this_thread::sleep_for(kThrough);
  const Time start = Clock::now();
  std::vector<Crowd*> all;
  for (auto& crowd : crowds) {
    all.push_back(crowd.get());
    crowd->begin(start);
  }
  Players players(all, options, start);
  players.start();
  const Time begin = later(start, kWarmUp_s), end = later(begin, options.seconds);
  std::this_thread::sleep_until(begin);
  players.stop();
  for (auto& crowd : crowds) {
    for (auto& client : crowd->clients) client->begin_measuring();
  }
  const auto before = connection.server_statistics();
  const Time measured_from = Clock::now();
  players.start();

  const Time never = end + std::chrono::hours(1);
  Time vanishes = options.vanish_every_s > 0 ? later(begin, options.vanish_every_s) : never, comes = never;
  for (Time now = Clock::now(); now < end && !interrupted(); now = Clock::now()) {
    std::this_thread::sleep_until(std::min(end, now + std::chrono::milliseconds(200)));
    now = Clock::now();
    progress(0.1 + 0.9 * Seconds(now - begin).count() / options.seconds);
    if (!crowds.front()->clients.empty()) {
      const auto state = connection.statistics(crowds.front()->clients.front()->id());
      if (state) out.load_level_most = std::max(out.load_level_most, state->load_level);
      const bool after = options.surge && now > later(begin, options.surge->to_s);
      if (state && after && state->load_level == 0 && !out.full_quality_after_s)
        out.full_quality_after_s = Seconds(now - begin).count() - options.surge->to_s;
      if (state && after && state->load_level > 0) out.full_quality_after_s.reset();
    }
    if (now >= vanishes && crowds.front()->clients.size() > 1) {
      players.stop();
      crowds.front()->lose(connection, crowds.front()->clients.size() / 2);
      ++out.vanished;
      players.start();
      vanishes = later(vanishes, options.vanish_every_s);
      comes = later(now, kComesBack_s);
    }
    if (now >= comes) {
      players.stop();
      if (!crowds.front()->add(connection)) ++out.refused;
      crowds.front()->begin(Clock::now());
      players.start();
      comes = never;
    }
  }
  players.stop();
  out.seconds = Seconds(Clock::now() - measured_from).count();
  const auto after = connection.server_statistics();
  std::size_t sessions = 0;
  for (auto& crowd : crowds) sessions += crowd->clients.size();
  if (before && after && sessions > 0)
    out.cpu_s_per_session_s = (after->cpu_s - before->cpu_s) / (out.seconds * static_cast<double>(sessions));
  if (players.failed()) return tl::unexpected(client::to_string(*players.failed()));
  std::this_thread::sleep_for(kThrough);
  out.crowd = crowds.front()->finish();
  if (options.heavy) out.heavy = crowds.back()->finish();
  return out;
}

bool sustained(const LoadFigures& figures, const LoadOptions& options) {
  const CrowdFigures& crowd = figures.crowd;
  return figures.refused == 0 && crowd.sessions == options.crowd.sessions && crowd.pcm_gaps == 0 && crowd.dropped.empty() &&
         crowd.deadline_misses == 0 && crowd.sums_exact &&
         crowd.latency.p99_ms < 1e3 * std::max(options.playout_delay_s, crowd.playout_delay_s) + kHeard_ms;
}

}  // namespace rustle::apps
