#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include "server/apps/daemon.h"
#include "server/engine/economy.h"

namespace rustle::apps {
namespace {

double in_seconds(session::WallClock::Duration duration) {
  return std::chrono::duration<double>(duration).count();
}

}  // namespace

bool Daemon::within_budget(Guest& sender, std::size_t bytes) {
  if (sender.session->options().clock != session::Clock::kLive) return true;
  const auto now = clock_->now();
  const double spent_s = in_seconds(sender.session->analysis_time());
  sender.analysis.use(spent_s - std::exchange(sender.analysis_spent_s, spent_s));
  sender.bytes.use(static_cast<double>(bytes));
  // Both are asked: what comes back does so by the time since it was asked last.
  const bool analysis_left = sender.analysis.left(now), bytes_left = sender.bytes.left(now);
  const bool within = guests_.size() == 1 || (analysis_left && bytes_left);
  sender.session->beyond_budget.store(!within);
  if (within) return true;
  sender.bytes.use(-static_cast<double>(bytes));  // what is dropped is not paid for
  const bool of_bytes = !bytes_left;
  notify(sender, {wire::ErrorCode::kQuotaExceeded,
                  of_bytes ? "budget.megabytes_per_s" : "budget.analysis",
                  of_bytes ? fmt::format("The session sends more than {} MB a second; frames are dropped.",
                                         options_.budget.megabytes_per_s)
                           : fmt::format("Its sheets take more than {} s of analysis a second; frames are dropped.",
                                         options_.budget.analysis_s_per_s),
                  of_bytes ? "Send fewer frames or smaller meshes, or start rustled with a higher --budget-megabytes."
                           : "Send fewer frames or coarser meshes, or start rustled with a higher --budget-analysis.",
                  0,
                  wire::Quota{of_bytes ? "bytes_per_s" : "analysis_s_per_s",
                              of_bytes ? 1e6 * options_.budget.megabytes_per_s : options_.budget.analysis_s_per_s, 0},
                  {}});
  return false;
}

session::LoadSigns Daemon::load_signs(Instant since_last_look) {
  session::LoadSigns signs;
  std::uint64_t suffered = 0;
  for (const auto& [id, guest] : guests_) {
    if (guest->session->beyond_budget.load() || guest->finished) continue;
    const auto counters = guest->session->counters();
    const auto backlog = counters.frames_dropped.find("backlog");
    const std::uint64_t now = counters.deadline_misses + (backlog == counters.frames_dropped.end() ? 0 : backlog->second);
    suffered += now - std::exchange(guest->suffered, now);
  }
  signs.suffers = suffered > 0;
  const auto busy = scheduler_->busy();
  const double elapsed_s = in_seconds(since_last_look);
  const double analysis = in_seconds(busy.analysis - told_busy_.analysis) / (elapsed_s * options_.analysis_workers);
  const double render = in_seconds(busy.render - told_busy_.render) / (elapsed_s * options_.render_workers);
  told_busy_ = busy;
  signs.busy = std::max(analysis, render);
  return signs;
}

void Daemon::watch_load() {
  const auto now = clock_->now();
  const auto since = now - looked_at_;
  if (since < session::LoadLadder::kLook) return;
  looked_at_ = now;
  const auto signs = load_signs(since);
  const auto level = ladder_.look(now, signs);
  if (!level) return;
  spdlog::log(*level > 0 ? spdlog::level::warn : spdlog::level::info,
              "load level {}: {}; workers are busy for {:.0f} % of their time{}", *level, engine::meaning_of(*level),
              100 * signs.busy, signs.suffers ? ", sessions lose frames or are late" : "");
  for (auto& [id, guest] : guests_) apply_load_level(*guest);
}

void Daemon::apply_load_level(Guest& guest) {
  if (guest.session->options().clock != session::Clock::kLive || guest.load_level == ladder_.level()) return;
  if (!hand_over(guest, engine::LoadLevel{ladder_.level()})) guest.load_level = ladder_.level();
}

wire::Error Daemon::overloaded() const {
  return {wire::ErrorCode::kOverloaded,
          "sessions",
          fmt::format("The daemon has more to do than it can, with {} attached: load level {}.", guests_.size(),
                      ladder_.level()),
          "Try again in a few seconds, attach to another daemon, or give this one more processors (--analysis-workers).",
          0,
          std::nullopt,
          {}};
}

}  // namespace rustle::apps
