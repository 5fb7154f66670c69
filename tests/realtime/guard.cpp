// Stops the program where a NonblockingScope allocates, locks or calls the system. Takes the place of the C library's
// functions, and has the kernel hand system calls over (PR_SET_SYSCALL_USER_DISPATCH), so that those of any library show.
#include "tests/realtime/watch.h"

#include <dlfcn.h>
#include <execinfo.h>
#include <pthread.h>
#include <semaphore.h>
#include <sys/prctl.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "server/synthesis/nonblocking_scope.h"

extern "C" {
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* old, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);
void __libc_free(void* p);
}

namespace {

// From <linux/prctl.h>, which not every C library's headers bring along.
constexpr int kSetSyscallUserDispatch = 59;
constexpr unsigned long kDispatchOn = 1;
constexpr char kAllow = 0, kBlock = 1;

thread_local int depth = 0;
thread_local volatile char system_calls = kAllow;
thread_local bool dispatched = false;

void say(const char* text) {
  if (::write(STDERR_FILENO, text, std::strlen(text)) < 0) std::abort();
}

[[noreturn]] void stop(const char* what) {
  system_calls = kAllow;
  depth = 0;
  say("the render path ");
  say(what);
  say(":\n");
  std::array<void*, 64> frames;
  const int count = ::backtrace(frames.data(), static_cast<int>(frames.size()));
  ::backtrace_symbols_fd(frames.data(), count, STDERR_FILENO);
  std::_Exit(rustle::realtime::kCaught);
}

void check(const char* what) {
  if (depth > 0) [[unlikely]]
    stop(what);
}

void called_system(int, siginfo_t* info, void*) {
  system_calls = kAllow;
  static std::array<char, 64> text;
  std::snprintf(text.data(), text.size(), "calls the system (number %d)", info->si_syscall);
  stop(text.data());
}

/// The C library's own function behind one of ours.
template <typename Function>
Function* next(Function*, const char* name) {
  void* found = ::dlsym(RTLD_NEXT, name);
  Function* function = nullptr;
  static_assert(sizeof(function) == sizeof(found));
  std::memcpy(&function, &found, sizeof(found));
  return function;
}

}  // namespace

namespace rustle::realtime {

Watch watch_this_thread() {
  std::array<void*, 1> frame;
  static_cast<void>(::backtrace(frame.data(), 1));  // loads what it needs
  struct sigaction action {};
  action.sa_sigaction = called_system;
  action.sa_flags = SA_SIGINFO | SA_NODEFER;
  ::sigaction(SIGSYS, &action, nullptr);
  dispatched = ::prctl(kSetSyscallUserDispatch, kDispatchOn, 0UL, 0UL, &system_calls) == 0;
  return {"guard", dispatched};
}

}  // namespace rustle::realtime

extern "C" {

void __rtsan_realtime_enter() noexcept {
  if (depth++ == 0 && dispatched) system_calls = kBlock;
}
void __rtsan_realtime_exit() noexcept {
  if (--depth == 0) system_calls = kAllow;
}

// ---- memory

void* malloc(std::size_t size) {
  check("allocates");
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  check("allocates");
  return __libc_calloc(count, size);
}
void* realloc(void* old, std::size_t size) {
  check("allocates");
  return __libc_realloc(old, size);
}
void* memalign(std::size_t alignment, std::size_t size) {
  check("allocates");
  return __libc_memalign(alignment, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  check("allocates");
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** out, std::size_t alignment, std::size_t size) {
  check("allocates");
  *out = __libc_memalign(alignment, size);
  return *out != nullptr ? 0 : ENOMEM;
}
void free(void* p) {
  if (p != nullptr) check("frees memory");
  __libc_free(p);
}

// ---- locks, and what waits

#define RUSTLE_GUARDED(result, name, parameters, arguments) \
  result name parameters {                                  \
    static const auto function = next(&name, #name);        \
    check("calls " #name);                                  \
    return function arguments;                              \
  }
RUSTLE_GUARDED(int, pthread_mutex_lock, (pthread_mutex_t * mutex), (mutex))
RUSTLE_GUARDED(int, pthread_rwlock_rdlock, (pthread_rwlock_t * lock), (lock))
RUSTLE_GUARDED(int, pthread_rwlock_wrlock, (pthread_rwlock_t * lock), (lock))
RUSTLE_GUARDED(int, pthread_spin_lock, (pthread_spinlock_t * lock), (lock))
RUSTLE_GUARDED(int, pthread_cond_signal, (pthread_cond_t * condition), (condition))
RUSTLE_GUARDED(int, pthread_cond_broadcast, (pthread_cond_t * condition), (condition))
RUSTLE_GUARDED(int, sem_wait, (sem_t * semaphore), (semaphore))
RUSTLE_GUARDED(int, sem_post, (sem_t * semaphore), (semaphore))
#undef RUSTLE_GUARDED
}
