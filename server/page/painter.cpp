#include "server/page/painter.h"

#include <sys/resource.h>

#include <algorithm>
#include <utility>

#include "server/session/worker_thread.h"

namespace rustle::page {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kLook{16};  // a frame waits no longer
constexpr milliseconds kScenePeriod{33};
constexpr std::chrono::seconds kLatencyOver{5};  // of what is told
constexpr int kPartitionShare = 80;              // regions are found again when so many times as long has passed as it took
constexpr int kSceneShare = 50;                  // the same of scenes, whose meshes may be large

double processor_s() {
  struct rusage used {};
  ::getrusage(RUSAGE_SELF, &used);
  const auto seconds = [](const timeval& time) {
    return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
  };
  return seconds(used.ru_utime) + seconds(used.ru_stime);
}

std::shared_ptr<const std::string> shared(std::string bytes) {
  return std::make_shared<const std::string>(std::move(bytes));
}

}  // namespace

Painter::Painter() : thread_([this] { run(); }) {}

Painter::~Painter() {
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
  }
  called_.notify_one();
  thread_.join();
}

void Painter::post(News news) {
  {
    const std::lock_guard lock(mutex_);
    news_.push_back(std::move(news));
  }
  called_.notify_one();
}

void Painter::run() {
  session::name_this_thread("rustle-page");
  std::vector<News> news;
  while (true) {
    news.clear();
    {
      std::unique_lock lock(mutex_);
      const auto called = [this] { return ends_ || !news_.empty(); };
      if (stages_.empty()) {
        called_.wait(lock, called);
      } else {
        called_.wait_for(lock, kLook, called);
      }
      if (ends_) return;
      news.swap(news_);
    }
    for (auto& each : news) std::visit([this](auto& it) { take(it); }, each);
    for (auto& [session, stage] : stages_) look_at(session, stage);
    for (auto& [id, viewer] : viewers_)
      if (std::exchange(viewer.has_news, false)) viewer.outlet->wake();
  }
}

// ------------------------------------------------------------------------------------------------------------ viewers

void Painter::take(Came& came) {
  viewers_[came.viewer].outlet = std::move(came.outlet);
}

void Painter::take(Gone& gone) {
  viewers_.erase(gone.viewer);
  drop_unwatched();
  if (viewers_.empty()) readings_.clear();
}

void Painter::take(Watches& watches) {
  const auto found = viewers_.find(watches.viewer);
  if (found == viewers_.end()) return;
  Viewer& viewer = found->second;
  viewer.outlet->box.forget_pictures();
  viewer.due.clear();
  viewer.watched = watches.session;
  viewer.period = std::chrono::duration_cast<Clock::duration>(std::chrono::seconds(1)) / watches.frames_per_second;
  drop_unwatched();
  if (viewer.watched.empty()) return;
  Stage& stage = stages_[viewer.watched];
  if (stage.watch != watches.watch) {
    stage = Stage{};
    stage.watch = std::move(watches.watch);
  }
  show(stage, viewer);
}

void Painter::drop_unwatched() {
  std::erase_if(stages_, [&](const auto& stage) {
    return std::none_of(viewers_.begin(), viewers_.end(),
                        [&](const auto& viewer) { return viewer.second.watched == stage.first; });
  });
}

void Painter::show(const Stage& stage, Viewer& viewer) {
  if (stage.scene_text) viewer.outlet->box.add_scene(stage.scene_text, stage.obstacles);
  for (const auto& [place, sheet] : stage.sheets)
    viewer.outlet->box.add_frame(place, sheet.frame_bytes, topology_of(place, sheet));
  viewer.has_news = true;
}

// -------------------------------------------------------------------------------------------------------------- sound

void Painter::take(Listens& listens) {
  const auto found = viewers_.find(listens.viewer);
  if (found == viewers_.end()) return;
  found->second.heard = listens.session;
  found->second.outlet->box.forget_pcm();
}

void Painter::take(Sound& sound) {
  const auto frames = static_cast<double>(sound.interleaved.size()) / sound.channels;
  std::shared_ptr<const std::string> bytes;
  for (auto& [id, viewer] : viewers_) {
    if (viewer.heard != sound.session) continue;
    if (!bytes) bytes = shared(pcm_bytes(sound.first_sample, sound.channels, sound.interleaved));
    viewer.outlet->box.add_pcm(bytes, frames / sound.rate_hz);
    viewer.has_news = true;
  }
}

// ------------------------------------------------------------------------------------------------------------ figures

OwnFigures Painter::own_figures(const Figures& figures) {
  const auto now = Clock::now();
  OwnFigures out;
  out.unix_s = std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
  out.viewers = viewers_.size();
  Reading reading{now, processor_s(), figures.sound};
  if (!readings_.empty()) {
    const Reading &last = readings_.back(), &oldest = readings_.front();
    const double lapse_s = std::chrono::duration<double>(now - last.at).count();
    if (lapse_s > 0) out.cpu_share = (reading.cpu_s - last.cpu_s) / lapse_s;
    auto since = figures.sound;
    // Sessions that have gone take their counts with them.
    for (std::size_t k = 0; k < since.in_range.size(); ++k)
      since.in_range[k] -= std::min(since.in_range[k], oldest.sound.in_range[k]);
    out.latency_p50_s = quantile_s(since, 0.5);
    out.latency_p99_s = quantile_s(since, 0.99);
  }
  readings_.push_back(reading);
  while (now - readings_.front().at > kLatencyOver) readings_.pop_front();
  return out;
}

void Painter::take(Told& told) {
  const OwnFigures own = own_figures(*told.figures);
  std::map<std::string, std::string> by_user;
  for (const auto& [id, user] : told.users) {
    const auto viewer = viewers_.find(id);
    const auto rights = told.figures->rights.find(user);
    if (viewer == viewers_.end() || rights == told.figures->rights.end()) continue;
    auto& text = by_user[user];
    if (text.empty()) text = figures_text(*told.figures, own, rights->second);
    viewer->second.outlet->box.add_figures(text);
    viewer->second.has_news = true;
  }
}

// ----------------------------------------------------------------------------------------------------------- pictures

void Painter::look_at(const std::string& session, Stage& stage) {
  for (session::Seen seen; stage.watch->next(seen);) std::visit([&](auto& it) { take(session, stage, it); }, seen);
  if (stage.scene_changed && Clock::now() >= stage.scene_due) paint_scene(session, stage);
}

Needed Painter::topology_of(std::uint32_t place, const Sheet& sheet) {
  return {place, {sheet.topology_bytes, true}};
}

void Painter::take(const std::string& session, Stage& stage, session::SeenFrame& seen) {
  Sheet& sheet = stage.sheets[seen.place];
  const sheet::MeshFrame& frame = seen.frame;
  const auto began = Clock::now();
  const bool another_mesh = sheet.topology != frame.topology;
  if (another_mesh) {
    stage.scene_changed |= !sheet.topology;
    sheet.topology = frame.topology;
    sheet.topology_bytes = shared(topology_bytes(seen.place, *frame.topology));
  }
  // A mesh that is new in every frame would flicker: its regions cannot be found as often as it comes.
  sheet.new_meshes = another_mesh ? sheet.new_meshes + 1 : 0;
  if (sheet.new_meshes <= 1 && began >= sheet.partition_due) {
    sheet.partition.update(frame);
    const auto ended = Clock::now();
    sheet.partition_due = ended + kPartitionShare * static_cast<int>(stage.sheets.size()) * (ended - began);
  }
  if (sheet.partition.topology() == frame.topology) {
    const auto ridges = sheet.partition.ridges(frame.positions_m), rulings = sheet.partition.rulings(frame.positions_m);
    sheet.frame_bytes = shared(frame_bytes(seen.place, frame, sheet.partition.regions(), ridges, rulings));
  } else {
    const std::vector<std::uint16_t> none(frame.positions_m.size(), kNoRegion);
    sheet.frame_bytes = shared(frame_bytes(seen.place, frame, none, {}, {}));
  }
  for (auto& [id, viewer] : viewers_) {
    if (viewer.watched != session) continue;
    auto& due = viewer.due.try_emplace(seen.place, began).first->second;
    if (began + viewer.period / 4 < due) continue;
    due = std::max(due, began - viewer.period / 2) + viewer.period;
    viewer.outlet->box.add_frame(seen.place, sheet.frame_bytes, topology_of(seen.place, sheet));
    viewer.has_news = true;
  }
}

void Painter::take(const std::string& session, Stage&, session::SeenEvents& seen) {
  const auto text = shared(events_text(session, seen));
  for (auto& [id, viewer] : viewers_) {
    if (viewer.watched != session) continue;
    viewer.outlet->box.add_events(text);
    viewer.has_news = true;
  }
}

void Painter::take(const std::string&, Stage& stage, engine::Surroundings& seen) {
  stage.around = std::move(seen);
  stage.scene_changed = true;
}

void Painter::paint_scene(const std::string& session, Stage& stage) {
  if (!stage.around) return;
  const auto began = Clock::now();
  std::vector<SheetSize> sizes(stage.around->sheets.size());
  for (const auto& [place, sheet] : stage.sheets)
    if (place < sizes.size() && sheet.topology)
      sizes[place] = {sheet.topology->vertex_count(), sheet.topology->triangle_count()};
  stage.obstacles.clear();
  std::uint32_t place = 0;
  std::vector<sheet::Vec3f> vertices_m;
  for (const auto& [id, track] : stage.around->scene->obstacles()) {
    const std::uint32_t index = place++;
    const scene::MeshShape* shape = track.mesh();
    if (shape == nullptr) continue;
    Mesh& mesh = stage.meshes[index];
    if (!mesh.bytes || mesh.revision != track.revision() || track.deforms()) {
      track.vertices_m(stage.around->time_s, vertices_m);
      mesh = {track.revision(), shared(obstacle_bytes(index, vertices_m, shape->triangles))};
    }
    stage.obstacles.push_back({kObstaclePlaces + index, {mesh.bytes, true}});
  }
  stage.scene_text = shared(scene_text(session, *stage.around, sizes));
  stage.scene_changed = false;
  const auto ended = Clock::now();
  stage.scene_due = ended + std::max<Clock::duration>(kScenePeriod, kSceneShare * (ended - began));
  for (auto& [id, viewer] : viewers_) {
    if (viewer.watched != session) continue;
    viewer.outlet->box.add_scene(stage.scene_text, stage.obstacles);
    viewer.has_news = true;
  }
}

}  // namespace rustle::page
