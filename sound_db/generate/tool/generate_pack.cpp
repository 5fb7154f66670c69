#include <cstdio>
#include <exception>

#include <fmt/format.h>

#include "sound_db/generate/generate.h"

/// rustle_generate_pack MATERIAL FOLDER: writes a default pack; the build's own step.
int main(int argc, char** argv) {
  if (argc != 3) {
    fmt::print(stderr, "usage: {} MATERIAL FOLDER\n", argv[0]);
    return 2;
  }
  try {
    const auto done = rustle::generate::write_pack(argv[1], argv[2]);
    if (done) return 0;
    fmt::print(stderr, "{}\n", done.error().text());
  } catch (const std::exception& error) {
    fmt::print(stderr, "{}: {}\n", argv[2], error.what());
  }
  return 1;
}
