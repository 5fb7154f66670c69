#include "server/apps/pack_reloads.h"

#include <exception>
#include <utility>

namespace rustle::apps {

PackReloads::PackReloads(std::shared_ptr<pack::PackLibrary> packs, std::uint32_t rate_hz, std::function<void()> wake)
    : packs_(std::move(packs)), rate_hz_(rate_hz), wake_(std::move(wake)), thread_([this] { run(); }) {}

PackReloads::~PackReloads() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void PackReloads::ask(Request request) {
  {
    const std::lock_guard lock(mutex_);
    asked_.push_back(std::move(request));
  }
  changed_.notify_all();
}

std::vector<PackReloads::Done> PackReloads::take_done() {
  const std::lock_guard lock(mutex_);
  return std::exchange(done_, {});
}

void PackReloads::run() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [this] { return stopping_ || !asked_.empty(); });
    if (stopping_) return;
    Done done{std::move(asked_.front()), {}};
    asked_.pop_front();
    lock.unlock();
    try {
      done.packs = packs_->reload(done.request.name, rate_hz_);
    } catch (const std::exception& failure) {  // such as no memory
      done.packs = tl::unexpected(pack::PackError{"", "", failure.what(), "try again when the machine has more room"});
    }
    lock.lock();
    done_.push_back(std::move(done));
    lock.unlock();
    wake_();
    lock.lock();
  }
}

}  // namespace rustle::apps
