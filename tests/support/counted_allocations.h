#pragma once

#include <cstddef>
#include <cstdlib>
#include <new>

/// Counts what a thread allocates. Replaces the global operator new: to be included by one source of a test program.
namespace rustle::test_support {

inline thread_local bool counting = false;
inline thread_local int allocations = 0;

/// How often the work allocates on this thread.
template <class Work>
int allocations_of(Work&& work) {
  allocations = 0;
  counting = true;
  work();
  counting = false;
  return allocations;
}

inline void* counted(std::size_t size, std::size_t alignment = alignof(std::max_align_t)) noexcept {
  if (counting) ++allocations;
  return std::aligned_alloc(alignment, (size + alignment) / alignment * alignment);
}

inline void* counted_or_throw(std::size_t size, std::size_t alignment = alignof(std::max_align_t)) {
  if (void* p = counted(size, alignment)) return p;
  throw std::bad_alloc();
}

/// Never inlined: beside a `new` that the compiler does not see through it would warn of a mismatch.
[[gnu::noinline]] inline void give_back(void* p) noexcept {
  std::free(p);
}

}  // namespace rustle::test_support

void* operator new(std::size_t size) {
  return rustle::test_support::counted_or_throw(size);
}
void* operator new[](std::size_t size) {
  return rustle::test_support::counted_or_throw(size);
}
void* operator new(std::size_t size, const std::nothrow_t&) noexcept {
  return rustle::test_support::counted(size);
}
void* operator new[](std::size_t size, const std::nothrow_t&) noexcept {
  return rustle::test_support::counted(size);
}
void* operator new(std::size_t size, std::align_val_t at) {
  return rustle::test_support::counted_or_throw(size, static_cast<std::size_t>(at));
}
void* operator new[](std::size_t size, std::align_val_t at) {
  return rustle::test_support::counted_or_throw(size, static_cast<std::size_t>(at));
}
void operator delete(void* p) noexcept {
  rustle::test_support::give_back(p);
}
void operator delete[](void* p) noexcept {
  rustle::test_support::give_back(p);
}
void operator delete(void* p, std::size_t) noexcept {
  rustle::test_support::give_back(p);
}
void operator delete[](void* p, std::size_t) noexcept {
  rustle::test_support::give_back(p);
}
void operator delete(void* p, std::align_val_t) noexcept {
  rustle::test_support::give_back(p);
}
void operator delete[](void* p, std::align_val_t) noexcept {
  rustle::test_support::give_back(p);
}
void operator delete(void* p, std::size_t, std::align_val_t) noexcept {
  rustle::test_support::give_back(p);
}
void operator delete[](void* p, std::size_t, std::align_val_t) noexcept {
  rustle::test_support::give_back(p);
}
