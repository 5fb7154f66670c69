#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include "server/page/encode.h"
#include "server/page/figures.h"
#include "server/page/outlet.h"
#include "server/page/partition.h"
#include "server/session/watch.h"

namespace rustle::page {

using ViewerId = std::uint64_t;

/// The page's own thread: finds the regions of sheets that are seen, encodes, and puts what came into viewers' outboxes.
/// Sleeps while nothing is watched and nothing comes.
class Painter {
 public:
  Painter();
  ~Painter();
  Painter(const Painter&) = delete;
  Painter& operator=(const Painter&) = delete;

  // ---- what happens, in its order; any thread, never waits

  struct Came {
    ViewerId viewer;
    std::shared_ptr<Outlet> outlet;
  };
  struct Gone {
    ViewerId viewer;
  };
  struct Watches {
    ViewerId viewer;
    std::string session;                    ///< empty: none
    std::shared_ptr<session::Watch> watch;  ///< the same for all who watch the session
    int frames_per_second = session::Watch::kFramesPerSecond;
  };
  struct Listens {
    ViewerId viewer;
    std::string session;  ///< empty: to none
  };
  struct Sound {
    std::string session;
    std::int64_t first_sample = 0;
    std::uint32_t rate_hz = 0;
    int channels = 0;
    std::vector<float> interleaved;
  };
  struct Told {
    std::shared_ptr<const Figures> figures;
    std::map<ViewerId, std::string> users;
  };
  using News = std::variant<Came, Gone, Watches, Listens, Sound, Told>;
  void post(News news);

 private:
  using Clock = std::chrono::steady_clock;

  struct Viewer {
    std::shared_ptr<Outlet> outlet;
    std::string watched, heard;
    Clock::duration period{};
    std::map<std::uint32_t, Clock::time_point> due;  ///< by sheet
    bool has_news = false;                           ///< its outlet is to be woken
  };
  struct Sheet {
    std::shared_ptr<const sheet::Topology> topology;
    std::shared_ptr<const std::string> topology_bytes, frame_bytes;
    Partition partition;
    Clock::time_point partition_due{};
    int new_meshes = 0;  ///< frames in a row that each had a mesh of their own
  };
  /// An obstacle's mesh as it was encoded.
  struct Mesh {
    std::uint64_t revision = 0;
    std::shared_ptr<const std::string> bytes;
  };
  /// A session that is watched.
  struct Stage {
    std::shared_ptr<session::Watch> watch;
    std::map<std::uint32_t, Sheet> sheets;  ///< by place
    std::optional<engine::Surroundings> around;
    bool scene_changed = false;
    Clock::time_point scene_due{};
    std::shared_ptr<const std::string> scene_text;
    std::vector<Needed> obstacles;
    std::map<std::uint32_t, Mesh> meshes;  ///< by obstacle
  };

  void run();
  void take(Came& came);
  void take(Gone& gone);
  void take(Watches& watches);
  void take(Listens& listens);
  void take(Sound& sound);
  void take(Told& told);
  void drop_unwatched();
  void look_at(const std::string& session, Stage& stage);
  void take(const std::string& session, Stage& stage, session::SeenFrame& seen);
  void take(const std::string& session, Stage& stage, session::SeenEvents& seen);
  void take(const std::string& session, Stage& stage, engine::Surroundings& seen);
  void paint_scene(const std::string& session, Stage& stage);
  static void show(const Stage& stage, Viewer& viewer);
  static Needed topology_of(std::uint32_t place, const Sheet& sheet);
  OwnFigures own_figures(const Figures& figures);

  std::mutex mutex_;
  std::condition_variable called_;
  std::vector<News> news_;
  bool ends_ = false;

  // page thread
  std::map<ViewerId, Viewer> viewers_;
  std::map<std::string, Stage> stages_;  ///< by session
  struct Reading {
    Clock::time_point at{};
    double cpu_s = 0;
    session::DurationHistogram::Counts sound;
  };
  std::deque<Reading> readings_;  ///< of the last seconds
  std::thread thread_;            ///< last made
};

}  // namespace rustle::page
