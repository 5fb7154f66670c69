#pragma once

/// Marks what the render worker may call: it neither locks, allocates, logs nor calls the system. Compilers that can check
/// it do.
#if defined(__clang__) && defined(__has_cpp_attribute)
#if __has_cpp_attribute(clang::nonblocking)
#define RUSTLE_NONBLOCKING [[clang::nonblocking]]
#endif
#endif
#ifndef RUSTLE_NONBLOCKING
#define RUSTLE_NONBLOCKING
#endif
