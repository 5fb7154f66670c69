#pragma once

namespace rustle::realtime {

/// Who stops the program when a NonblockingScope of this thread does what it must not: the allocation guard of this folder,
/// or the runtime of RealtimeSanitizer, whichever the program is linked with.
struct Watch {
  const char* name;
  bool sees_system_calls;  ///< false where the kernel does not hand them over (Linux before 5.11)
};

/// Call it once, outside of any scope.
Watch watch_this_thread();

/// The exit status of a program that the guard has stopped.
inline constexpr int kCaught = 43;

}  // namespace rustle::realtime
