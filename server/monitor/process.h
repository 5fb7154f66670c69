#pragma once

#include <cstdint>
#include <map>
#include <string>

namespace rustle::monitor {

/// What the kernel says of this process. [any thread]
struct ProcessFigures {
  /// Of all threads of one name.
  struct Threads {
    std::uint64_t count = 0;
    double running_s = 0;  ///< on a processor
    double waiting_s = 0;  ///< for one: the run-queue delay
  };
  double cpu_s = 0;
  double resident_bytes = 0;
  std::uint64_t open_files = 0;
  std::map<std::string, Threads> threads;
};

/// Reads /proc/self; what cannot be read is 0.
ProcessFigures process_figures();

}  // namespace rustle::monitor
