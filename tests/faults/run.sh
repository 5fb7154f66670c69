#!/usr/bin/env bash
# Injects the whole table of faults into rustled, and prints a line each: injected | expected | seen. Status 0 when all hold.
# usage: tests/faults/run.sh [--quick] [NAME ...]     --quick: fewer of each, as CTest has it; NAME: these only
# Needs root for networks and file systems of its own. Example: tests/faults/run.sh partition disk_full
set -euo pipefail
cd "$(dirname "$0")/../.."
if [ "${1:-}" = --help ]; then
  sed -n '2,4s/^# //p' "$0"
  exit 0
fi
# shellcheck source=deploy/packages.sh
. deploy/packages.sh
rustle_install_packages test
build=${RUSTLE_BUILD:-build/release}
cmake --preset release -DRUSTLE_TESTS=ON -DCMAKE_CXX_COMPILER_LAUNCHER=ccache --log-level=WARNING
cmake --build --preset release --target rustled rustle rustle_python rustle_packs fault_captures
# File systems that it mounts are its own.
exec unshare --mount env RUSTLE_BUILD="$(realpath "$build")" /usr/bin/python3 tests/faults/faults.py "$@"
