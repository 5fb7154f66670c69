#!/usr/bin/env bash
# Leaves a rustled at 60 % of a core for an hour and looks whether it stays as it is: memory, descriptors, threads, gaps.
# usage: tests/soak/run.sh [--minutes N] [--load SHARE]     [60, 0.6]
# Prints a line a minute. Status 0: memory grows by less than 1 MiB an hour, no sound is missing, nothing is left open.
# Example: tests/soak/run.sh --minutes 10
set -euo pipefail
cd "$(dirname "$0")/../.."
if [ "${1:-}" = --help ]; then
  sed -n '2,5s/^# //p' "$0"
  exit 0
fi
# shellcheck source=deploy/packages.sh
. deploy/packages.sh
rustle_install_packages test >&2
build=${RUSTLE_BUILD:-build/release}
cmake --preset release -B "$build" -DRUSTLE_TESTS=ON -DCMAKE_CXX_COMPILER_LAUNCHER=ccache --log-level=WARNING
cmake --build "$build" --target rustled rustle rustle_python rustle_packs
RUSTLE_BUILD=$(realpath "$build") exec /usr/bin/python3 tests/soak/soak.py "$@"
