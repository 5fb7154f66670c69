#include "server/sinks/playback.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>
#include <vector>

namespace rustle::sinks {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kTurn{4};
constexpr milliseconds kSilentCallback{150};
constexpr milliseconds kWindow{50};           // in which a spinning callback is recognised
constexpr milliseconds kSettling{300};        // a device that was just opened fills buffers of its own, with silence
constexpr milliseconds kFilling{1000};        // in which it may do so faster than it plays
constexpr double kSpinning = 3;               // times its rate
constexpr milliseconds kSearchInterval{500};  // for the first minute, then ten times as long
constexpr int kEagerSearches = 120;

}  // namespace

Playback::Playback(Options options, Tell tell)
    : options_(std::move(options)),
      tell_(std::move(tell)),
      mix_(options_.device.rate_hz, options_.device.channels),
      rate_hz_(options_.device.rate_hz),
      channels_(options_.device.channels) {
  mix_.rest();
  finder_ = std::thread([this] { run_finder(); });
  player_ = std::thread([this] { run_player(); });
}

Playback::~Playback() {
  {
    std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  player_.join();
  finder_.join();
}

PlaybackFigures Playback::figures() const {
  std::lock_guard lock(mutex_);
  PlaybackFigures out = figures_;
  out.mix = mix_.figures();
  return out;
}

void Playback::run_finder() {
  std::string last_complaint;
  int searches = 0;
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    if (!wanted_) {
      changed_.wait(lock, [this] { return stopping_ || wanted_; });
      continue;
    }
    lock.unlock();
    auto opened = AudioDevice::open(options_.device);
    if (!opened && std::exchange(last_complaint, opened.error()) != opened.error()) tell_(opened.error());
    searches = opened ? 0 : searches + 1;
    if (opened) last_complaint.clear();
    lock.lock();
    if (opened) {
      found_ = std::move(*opened);
      wanted_ = false;
      changed_.notify_all();
    } else {
      const auto pause = searches < kEagerSearches ? kSearchInterval : 10 * kSearchInterval;
      changed_.wait_for(lock, pause, [this] { return stopping_; });
    }
  }
}

void Playback::take_found(Clock::time_point now) {
  std::unique_ptr<AudioDevice> found;
  {
    std::lock_guard lock(mutex_);
    found = std::move(found_);
    if (found) {
      figures_.device = found->name();
      figures_.rate_hz = found->rate_hz();
      ++figures_.devices_opened;
    }
  }
  if (!found) return;
  device_ = std::move(found);
  rate_hz_ = device_->rate_hz();
  channels_ = device_->channels();
  called_ = window_called_ = device_->frames_called();
  missed_ = 0;
  called_at_ = window_began_ = opened_at_ = now;
  tell_(fmt::format("playing on {}: {} Hz, {} channels", device_->name(), rate_hz_, channels_));
}

bool Playback::lost(Clock::time_point now) {
  const std::uint64_t called = device_->frames_called();
  if (called != std::exchange(called_, called)) called_at_ = now;
  if (now - called_at_ > kSilentCallback) return true;
  if (now - window_began_ < kWindow) return false;
  const std::chrono::duration<double> window = now - std::exchange(window_began_, now);
  const auto frames = static_cast<double>(called - std::exchange(window_called_, called));
  const double most = kSpinning * window.count() * rate_hz_ + 4.0 * device_->block_frames();
  if (frames > most && now - opened_at_ > kFilling) return true;
  const std::uint64_t missed = device_->frames_missed();
  std::lock_guard lock(mutex_);
  figures_.frames_missed += missed - std::exchange(missed_, missed);
  return false;
}

void Playback::run_player() {
  while (true) {
    {
      std::unique_lock lock(mutex_);
      changed_.wait_for(lock, device_ ? kTurn : kSilentCallback, [this] { return stopping_ || found_; });
      if (stopping_) return;
    }
    const auto now = Clock::now();
    if (!device_) take_found(now);
    if (device_ && lost(now)) {
      tell_(fmt::format("{} is gone; playing to nothing until a device answers", device_->name()));
      device_.reset();
      playing_ = false;
      mix_.rest();
      std::lock_guard lock(mutex_);
      figures_.device.clear();
      ++figures_.devices_lost;
      wanted_ = true;
      changed_.notify_all();
    }
    if (!device_) continue;
    if (!playing_ && now - opened_at_ <= kSettling) {
      feed_silence();
      continue;
    }
    if (!std::exchange(playing_, true)) mix_.turn_to(rate_hz_, channels_);
    feed_device();
  }
}

std::size_t Playback::lead_frames() const {
  return std::max<std::size_t>(static_cast<std::size_t>(options_.lead_s * rate_hz_), 2 * device_->block_frames());
}

void Playback::feed_device() {
  const std::size_t lead = lead_frames();
  const std::size_t waiting = device_->waiting_frames();
  if (waiting >= lead) return;
  block_.resize((lead - waiting) * static_cast<std::size_t>(channels_));
  mix_.mix(block_);
  device_->write(block_);
  std::lock_guard lock(mutex_);
  figures_.frames_played += lead - waiting;
}

void Playback::feed_silence() {
  block_.assign((lead_frames() - std::min(lead_frames(), device_->waiting_frames())) * static_cast<std::size_t>(channels_),
                0);
  device_->write(block_);
}

}  // namespace rustle::sinks
