#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <tl/expected.hpp>

namespace rustle::session {

/// What the system grants to threads that have deadlines.
enum class Priority : std::uint8_t {
  kNormal,    ///< nothing
  kNice,      ///< before others, as a rule (a negative nice value)
  kRealTime,  ///< before all that is not real time (SCHED_RR)
};

/// Gives the calling thread the highest of these that the system grants.
Priority raise_this_thread();

/// Keeps the calling thread on these processors; none: wherever the system likes. False: the system has none of them.
bool pin_this_thread(const std::vector<int>& cpus);

/// The calling thread's name in system tools, at most 15 characters.
void name_this_thread(const char* name);

/// "0-2,5" as processors, each once, ascending. Error: a sentence that says what is wrong.
tl::expected<std::vector<int>, std::string> parse_cpus(std::string_view list);

/// How many processors this process may use.
int usable_cpus();

}  // namespace rustle::session
