// Makes an allocation of a program fail on purpose: LD_PRELOAD it.
//   RUSTLE_FAULT_NEW=FILE   FILE begins with a 64-bit number n; while it is not 0 it counts down with every allocation by
//                           `new` in the program itself, not in its libraries or ZeroMQ's threads, from when it has set
//                           its terminate handler, and the one that brings it to 0 fails
#include <fcntl.h>
#include <link.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <unistd.h>

#include <atomic>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <new>

namespace {

using Countdown = std::atomic<std::int64_t>;

Countdown* open_countdown() {
  const char* file = std::getenv("RUSTLE_FAULT_NEW");
  const int descriptor = file == nullptr ? -1 : ::open(file, O_RDWR | O_CLOEXEC);
  if (descriptor < 0) return nullptr;
  void* place = ::mmap(nullptr, sizeof(Countdown), PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
  ::close(descriptor);
  return place == MAP_FAILED ? nullptr : static_cast<Countdown*>(place);
}

struct Range {
  std::uintptr_t begin = 0, end = 0;
};

/// Where the program's own code lies: the first object of the process.
Range program() {
  Range out;
  dl_iterate_phdr(
      [](dl_phdr_info* object, std::size_t, void* range) {
        for (int k = 0; k < object->dlpi_phnum; ++k) {
          const auto& part = object->dlpi_phdr[k];
          if (part.p_type == PT_LOAD && (part.p_flags & PF_X) != 0)
            *static_cast<Range*>(range) = {object->dlpi_addr + part.p_vaddr,
                                           object->dlpi_addr + part.p_vaddr + part.p_memsz};
        }
        return 1;
      },
      &out);
  return out;
}

bool is_of_zeromq() {
  char name[16] = {};
  ::prctl(PR_GET_NAME, name);
  return std::strncmp(name, "ZMQ", 3) == 0;
}

/// Libraries are initialized first, and find functions of std::string in the program. It says itself when it begins.
bool has_begun() {
  static const std::terminate_handler libraries = std::get_terminate();
  return std::get_terminate() != libraries;
}

bool fails(const void* caller) {
  static Countdown* const countdown = open_countdown();
  static const Range own = program();
  const auto at = reinterpret_cast<std::uintptr_t>(caller);
  if (countdown == nullptr || countdown->load(std::memory_order_relaxed) <= 0 || at < own.begin || at >= own.end)
    return false;
  return has_begun() && !is_of_zeromq() && countdown->fetch_sub(1) == 1;
}

}  // namespace

void* operator new(std::size_t bytes) {
  void* place = fails(__builtin_return_address(0)) ? nullptr : std::malloc(bytes == 0 ? 1 : bytes);
  if (place == nullptr) throw std::bad_alloc();
  return place;
}
void operator delete(void* place) noexcept {
  std::free(place);
}
void operator delete(void* place, std::size_t) noexcept {
  std::free(place);
}
