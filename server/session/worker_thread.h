#pragma once

#include <array>
#include <chrono>
#include <cstddef>
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

/// How long one thread has waited for a processor although it could have run, as the kernel's schedstat says; 0 where it
/// says nothing. Looking takes less than a microsecond, but calls the system. [the thread that made it]
class RunDelay {
 public:
  /// Of the calling thread.
  RunDelay();
  ~RunDelay();
  RunDelay(const RunDelay&) = delete;
  RunDelay& operator=(const RunDelay&) = delete;

  /// Since the thread began.
  std::chrono::nanoseconds total() const;
  /// Takes note of it; at most once a millisecond, the newest kNotes are kept. `now` is any clock's that does not go back.
  void note(std::chrono::nanoseconds now);
  /// Between the newest note that is not after `moment` and this moment; where there is none, since the oldest note.
  std::chrono::nanoseconds since(std::chrono::nanoseconds moment) const;

 private:
  static constexpr std::size_t kNotes = 256;
  struct Note {
    std::chrono::nanoseconds at{}, total{};
  };
  int file_;
  std::array<Note, kNotes> notes_{};
  std::size_t noted_ = 0;
};

/// The calling thread's name in system tools, at most 15 characters.
void name_this_thread(const char* name);

/// "0-2,5" as processors, each once, ascending. Error: a sentence that says what is wrong.
tl::expected<std::vector<int>, std::string> parse_cpus(std::string_view list);

/// How many processors this process may use.
int usable_cpus();

}  // namespace rustle::session
