#include "server/apps/load_client.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace rustle::apps {
namespace {

using std::chrono::milliseconds;
using Seconds = std::chrono::duration<double>;

constexpr float kSilence = 1e-5f;

}  // namespace

tl::expected<std::unique_ptr<LoadClient>, client::Error> LoadClient::attach(const client::Connection& connection,
                                                                            const std::string& name, LoadPlan plan) {
  client::SessionOptions options;
  options.name = name;
  options.seed = plan.seed;
  options.default_material = plan.material;
  if (plan.playout_delay_s > 0) options.playout_delay_s = plan.playout_delay_s;
  client::SheetOptions sheet;
  if (plan.loop->cloth) sheet.kind = client::SheetKind::kCloth;
  if (plan.loop->cloth && plan.material.empty()) sheet.material = "cotton";
  options.sheets = {sheet};
  auto session = client::Session::attach(connection, options, {.reconnect = false});
  if (!session) return tl::unexpected(session.error());
  auto reader = session->listen({.blocks = plan.blocks});
  if (!reader) return tl::unexpected(reader.error());
  if (plan.loop->on_table) {
    client::SceneUpdate scene;
    scene.obstacles = {{.id = 1, .name = "table", .surface_material = "wooden-table", .shape = client::Plane{}}};
    if (auto sent = session->scene(scene); !sent) return tl::unexpected(sent.error());
  }
  std::unique_ptr<LoadClient> made(new LoadClient(std::move(*session), std::move(*reader), std::move(plan)));
  made->start_ = made->planned_ = made->send_at_ = std::chrono::steady_clock::now();
  if (auto sent = made->send(1); !sent) return tl::unexpected(sent.error());
  return made;
}

void LoadClient::begin(Time first) {
  time_s_ = Seconds(first - start_).count();
  planned_ = send_at_ = first;
}

LoadClient::LoadClient(client::Session session, client::PcmReader reader, LoadPlan plan)
    : session_(std::move(session)),
      reader_(std::move(reader)),
      plan_(std::move(plan)),
      random_(plan_.seed),
      frame_(plan_.phase) {}

void LoadClient::plan_next(double speed) {
  time_s_ += 1 / (plan_.frames_per_s * speed);
  ++frame_;
  planned_ = later(start_, time_s_ + plan_.jitter_s * std::generate_canonical<double, 53>(random_));
  send_at_ = std::max(send_at_, planned_);
}

tl::expected<void, client::Error> LoadClient::send_mesh(std::size_t mesh) {
  if (mesh_ == mesh) return {};
  const auto& sent = plan_.loop->meshes[mesh];
  client::Topology topology;
  topology.id = ++topologies_;
  topology.vertex_count = static_cast<std::uint32_t>(sent.material_coordinates.size());
  topology.triangles = {sent.triangles.front().data(), 3 * sent.triangles.size()};
  topology.material_coordinates = {sent.material_coordinates.front().data(), 2 * sent.material_coordinates.size()};
  if (auto added = session_.add_topology(topology); !added) return tl::unexpected(added.error());
  mesh_ = mesh;
  return {};
}

tl::expected<void, client::Error> LoadClient::send(double speed) {
  const bool withheld = plan_.withheld > 0 && std::generate_canonical<double, 53>(random_) < plan_.withheld;
  const auto& frame = plan_.loop->frames[frame_ % plan_.loop->frames.size()];
  fresh_ = fresh_ || frame.fresh;
  if (!withheld) {
    if (auto sent = send_mesh(frame.mesh); !sent) return sent;
    client::FrameExtras extras;
    extras.reset_history = std::exchange(fresh_, false);
    std::vector<client::TearTip> tips;
    for (const auto& tip : frame.tear_tips)
      tips.push_back({tip.id, tip.position_m, speed * tip.speed_m_per_s, tip.direction});
    extras.tear_tips = tips;
    const Time now = std::chrono::steady_clock::now();
    {
      std::lock_guard lock(mutex_);
      under_way_.push_back({time_s_, now});
    }
    auto sent = session_.frame(1, topologies_, time_s_, frame.xyz_m, extras);
    if (!sent) return tl::unexpected(sent.error());
    if (*sent == client::Sent::kQueued) ++sent_.frames_sent;
    sent_.late_s.push_back(static_cast<float>(Seconds(now - send_at_).count()));
  }
  plan_next(speed);
  return {};
}

bool LoadClient::listen() {
  bool any = false;
  while (const auto block = reader_.next(milliseconds(0))) {
    any = true;
    if (block->end) continue;
    if (block->missing_samples > 0) ++heard_.pcm_gaps;
    const double length_s = static_cast<double>(block->samples) / block->rate_hz;
    const bool sounds = std::any_of(block->interleaved.begin(), block->interleaved.end(),
                                    [](float sample) { return std::abs(sample) > kSilence; });
    sounded_ = sounded_ || sounds;
    silent_s_ = sounds || !sounded_ ? 0 : silent_s_ + length_s;
    heard_.longest_silence_s = std::max(heard_.longest_silence_s, silent_s_);
    const Time now = std::chrono::steady_clock::now();
    std::lock_guard lock(mutex_);
    while (!under_way_.empty() && under_way_.front().time_s < block->time_s + length_s) {
      heard_.latency_s.push_back(static_cast<float>(Seconds(now - under_way_.front().sent).count()));
      under_way_.pop_front();
    }
  }
  return any;
}

void LoadClient::begin_measuring() {
  heard_.latency_s.clear();
  sent_.late_s.clear();
}

LoadClient::Figures LoadClient::take_figures() {
  heard_.frames_sent = sent_.frames_sent;
  heard_.late_s = std::move(sent_.late_s);
  return std::move(heard_);
}

}  // namespace rustle::apps
