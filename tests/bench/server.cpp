// The daemon as a simulator and a listener meet it: a frame's way from the client's frame() to the PCM message in which its
// moment begins to sound, through real sockets, in real time.
#include "tests/bench/bench.h"

#include <unistd.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <map>
#include <mutex>
#include <thread>

#include <spdlog/spdlog.h>

#include "client_sdk/cpp/session.h"
#include "client_sdk/sheets/demos.h"
#include "server/apps/daemon.h"

namespace rustle::bench {
namespace {

using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;

constexpr double kDelay_s = 0.040;  // chosen, so that what lies beyond it shows
constexpr double kFrames_per_s = 60;
constexpr std::size_t kTriangles = 1333;

[[noreturn]] void refuse(const std::string& why) {
  fmt::print(stderr, "{}\n", why);
  std::exit(1);
}

/// How long the threads of this process have waited for a processor so far, all together.
double waited_us() {
  double sum_us = 0;
  for (const auto& task : std::filesystem::directory_iterator("/proc/self/task")) {
    std::ifstream file(task.path() / "schedstat");
    double running_ns = 0, waiting_ns = 0;
    if (file >> running_ns >> waiting_ns) sum_us += waiting_ns / 1000;
  }
  return sum_us;
}

/// A daemon in this process, as `rustled` runs it.
class Served {
 public:
  Served() {
    spdlog::set_level(spdlog::level::off);
    const std::string start = fmt::format("ipc:///tmp/rustle-bench-{}", ::getpid());
    apps::DaemonOptions options;
    options.sockets.control = control = start + "-control";
    options.sockets.stream = start + "-stream";
    options.sockets.out = start + "-out";
    auto packs = std::make_shared<pack::PackLibrary>();
    auto opened = apps::Daemon::open(options, packs);
    if (!opened) refuse(opened.error());
    daemon_ = std::move(*opened);
    thread_ = std::thread([this] { daemon_->run(stop_); });
  }
  ~Served() {
    stop_ = true;
    thread_.join();
  }

  std::string control;

 private:
  std::unique_ptr<apps::Daemon> daemon_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

struct Heard {
  std::mutex mutex;
  std::map<double, Clock::time_point> sent;  ///< by simulation time: frames whose sound has not come
  Timings beyond_delay;
  Timings run_queue;  ///< meanwhile, of all threads together
};

void listen(client::PcmReader reader, Heard& heard, const std::atomic<bool>& stop) {
  while (!stop) {
    const auto block = reader.next(std::chrono::milliseconds(200));
    if (!block) continue;
    if (block->end) return;
    const auto now = Clock::now();
    const double end_s = block->time_s + static_cast<double>(block->samples) / block->rate_hz;
    std::lock_guard lock(heard.mutex);
    while (!heard.sent.empty() && heard.sent.begin()->first < end_s) {
      heard.beyond_delay.add((Seconds(now - heard.sent.begin()->second).count() - kDelay_s) * 1e6);
      heard.sent.erase(heard.sent.begin());
    }
  }
}

int measure(const Options& options) {
  Served served;
  auto connection = client::Connection::connect({served.control, {}, {}});
  if (!connection) refuse(client::to_string(connection.error()));
  client::SessionOptions wanted;
  wanted.name = "latency";
  wanted.clock = client::Clock::kLive;
  wanted.block_size = 128;
  wanted.playout_delay_s = kDelay_s;
  wanted.sheets = {client::SheetOptions{}};
  auto session = client::Session::attach(*connection, wanted);
  if (!session) refuse(client::to_string(session.error()));
  auto reader = session->listen({.blocks = 1});
  if (!reader) refuse(client::to_string(reader.error()));

  const auto sheet = sheets::make_demo("shake", kTriangles);
  const auto& mesh = sheet->mesh();
  const std::size_t vertices = mesh.material_coordinates.size();
  client::Topology topology;
  topology.vertex_count = static_cast<std::uint32_t>(vertices);
  topology.triangles = {mesh.triangles.front().data(), 3 * mesh.triangles.size()};
  topology.material_coordinates = {mesh.material_coordinates.front().data(), 2 * vertices};
  if (auto sent = session->add_topology(topology); !sent) refuse(client::to_string(sent.error()));

  Heard heard;
  std::atomic<bool> stop{false};
  std::thread listener([&, pcm = std::move(*reader)]() mutable { listen(std::move(pcm), heard, stop); });
  std::vector<float> positions(3 * vertices);
  const auto start = Clock::now() + std::chrono::milliseconds(50);
  const int settling = static_cast<int>(2 * kFrames_per_s);
  double waited = waited_us();
  for (int k = 0; k < options.frames + settling; ++k) {
    const double time_s = k / kFrames_per_s;
    sheet->positions(std::fmod(time_s, 2.0), positions);
    std::this_thread::sleep_until(start + std::chrono::duration_cast<Clock::duration>(Seconds(time_s)));
    if (k >= settling) {
      std::lock_guard lock(heard.mutex);
      heard.sent.emplace(time_s, Clock::now());
    }
    if (auto sent = session->frame(1, 1, time_s, positions); !sent) refuse(client::to_string(sent.error()));
    const double by_now = waited_us();
    if (k > settling) heard.run_queue.add(by_now - waited);
    waited = by_now;
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  stop = true;
  listener.join();
  const auto figures = session->detach();
  if (!figures) refuse(client::to_string(figures.error()));

  Report report(options);
  const auto add = [&](const std::string& name, const Timings& times, std::size_t count) {
    report.add({name, count, times.median_us(), times.quantile_us(0.95), std::numeric_limits<double>::quiet_NaN(), "frames",
                times.mean_us()});
  };
  const auto frames = static_cast<std::size_t>(options.frames);
  add("server/frame to sound", heard.beyond_delay, frames);
  add("server/run queue", heard.run_queue, frames);
  report.note(fmt::format(
      "frame() to the message in which its moment sounds, beyond the playout delay of {:.0f} ms; 99th percentile "
      "{:.0f} us",
      1e3 * kDelay_s, heard.beyond_delay.quantile_us(0.99)));
  report.note(fmt::format(
      "run queue: what all threads of daemon, simulator and listener waited for a processor meanwhile, in a frame's "
      "interval; 99th percentile {:.0f} us",
      heard.run_queue.quantile_us(0.99)));
  report.note(fmt::format("{} of {} frames analysed, {} late, {} input gaps", figures->frames_analysed,
                          figures->frames_received, figures->frames_late, figures->input_gaps));
  report.goal("frame to sound beyond the delay, p99, ms", heard.beyond_delay.quantile_us(0.99) / 1000, 10);
  return report.finish();
}

}  // namespace
}  // namespace rustle::bench

int main(int argc, char** argv) {
  return rustle::bench::measure(rustle::bench::read_options(argc, argv));
}
