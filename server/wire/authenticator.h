#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <thread>

namespace rustle::wire {

/// Answers ZeroMQ's questions who may connect (ZAP, RFC 27) on inproc://zeromq.zap.01, in a thread of its own. CURVE alone
/// admits any key that knows the daemon's; here it must be welcome, and only in our domain. NULL and PLAIN never are.
/// The user id of what an admitted peer sends is its public key in Z85.
class Authenticator {
 public:
  /// Made before anything is bound, ended before the context. \pre `context` has room for two more sockets
  Authenticator(void* context, std::function<bool(const std::string& public_key)> admits);
  ~Authenticator();
  Authenticator(const Authenticator&) = delete;
  Authenticator& operator=(const Authenticator&) = delete;

  /// False: the handler could not be bound; nobody would be asked.
  bool runs() const { return thread_.joinable(); }

  struct Counters {
    std::uint64_t admitted = 0, refused = 0;
  };
  /// Any thread.
  Counters counters() const { return {admitted_.load(), refused_.load()}; }

 private:
  void serve();
  /// The status of a request's parts, and its user.
  std::string status_of(const std::string& domain, const std::string& mechanism, const std::string& credentials,
                        std::string& user) const;

  void* questions_ = nullptr;
  void* end_here_ = nullptr;   ///< this side of a pair
  void* end_there_ = nullptr;  ///< the thread's
  const std::function<bool(const std::string& public_key)> admits_;
  std::atomic<std::uint64_t> admitted_{0}, refused_{0};
  std::thread thread_;
};

}  // namespace rustle::wire
