#!/usr/bin/env bash
# Whether every C and C++ file is laid out as .clang-format says.
# usage: tests/architecture/format.sh [--fix]
set -euo pipefail
cd "$(dirname "$0")/../.."
mode=(--dry-run -Werror)
[ "${1:-}" = --fix ] && mode=(-i)
find server client_sdk sound_db tests \( -name node_modules -prune \) -o \( -name '*.h' -o -name '*.cpp' -o -name '*.c' \) -print0 |
  xargs -0 clang-format "${mode[@]}"
