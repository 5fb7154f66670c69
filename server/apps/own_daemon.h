#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

#include <tl/expected.hpp>

namespace rustle::apps {

/// A `rustled` of one's own: the program beside this one, with sockets in a folder of its own, ended with this object.
class OwnDaemon {
 public:
  struct Options {
    std::size_t max_sessions = 256;
    std::vector<int> cpus;               ///< processors that it may run on; empty: all
    std::vector<std::string> arguments;  ///< more of them
  };
  /// Error: a sentence with the remedy.
  [[nodiscard]] static tl::expected<OwnDaemon, std::string> start(const Options& options);

  OwnDaemon(OwnDaemon&& other) noexcept;
  OwnDaemon& operator=(OwnDaemon&&) = delete;
  ~OwnDaemon();

  /// Endpoint to connect to.
  std::string control() const;
  bool runs();  ///< false: it has ended by itself

 private:
  OwnDaemon(std::string folder, pid_t process) : folder_(std::move(folder)), process_(process) {}

  std::string folder_;
  pid_t process_;
};

}  // namespace rustle::apps
