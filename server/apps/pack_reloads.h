#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include <tl/expected.hpp>

#include "server/wire/sockets.h"
#include "sound_db/pack/library.h"

namespace rustle::apps {

/// Reads packs anew for who asks by control, one request after the other, on a thread of its own: the network thread reads
/// no file.
class PackReloads {
 public:
  struct Request {
    wire::ControlPeer peer;
    std::uint64_t request_id = 0;
    std::string name;  ///< as PackLibrary::reload has it
  };
  struct Done {
    Request request;
    tl::expected<std::vector<std::shared_ptr<const pack::SoundPack>>, pack::PackError> packs;
  };

  /// `wake` is called when something is done, on the reading thread.
  PackReloads(std::shared_ptr<pack::PackLibrary> packs, std::uint32_t rate_hz, std::function<void()> wake);
  /// Waits for what is being read; what has not begun is not.
  ~PackReloads();
  PackReloads(const PackReloads&) = delete;
  PackReloads& operator=(const PackReloads&) = delete;

  /// [network thread]
  void ask(Request request);
  /// What was done since the last call, in order. [network thread]
  std::vector<Done> take_done();

 private:
  void run();

  const std::shared_ptr<pack::PackLibrary> packs_;
  const std::uint32_t rate_hz_;
  const std::function<void()> wake_;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool stopping_ = false;
  std::deque<Request> asked_;
  std::vector<Done> done_;
  std::thread thread_;
};

}  // namespace rustle::apps
