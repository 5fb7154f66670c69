#pragma once

/// Marks a function to be compiled for several instruction sets; the best that the processor has is chosen when the program
/// starts. Such functions keep every sum in one order, so that all give the same bits (-ffp-contract=off).
#if defined(__x86_64__) && defined(__ELF__) && !defined(__SANITIZE_THREAD__) && !defined(__clang__)
#define RUSTLE_SIMD __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else  // ThreadSanitizer starts after the choice is made; clang 19 leaves out what only such functions use
#define RUSTLE_SIMD
#endif
