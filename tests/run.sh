#!/usr/bin/env bash
# Installs packages, builds, runs every test. What CI runs, a person runs.
# usage: tests/run.sh [arguments of ctest, such as -R unit]
set -euo pipefail
cd "$(dirname "$0")/.."
if [ "${1:-}" = --help ]; then
  sed -n '2,3s/^# //p' "$0"
  exit 0
fi
# shellcheck source=deploy/packages.sh
. deploy/packages.sh
rustle_install_packages test
cmake --preset release -DRUSTLE_TESTS=ON -DCMAKE_CXX_COMPILER_LAUNCHER=ccache
cmake --build --preset release --target all all_verify_interface_header_sets
rm -f build/release/Testing/Temporary/LastTestsFailed.log
ctest --preset release --parallel 2 "$@" && exit
# A stall of a shared machine must not hide among true failures: what failed has to pass alone, and is named either way.
echo "Once more, one at a time, what failed:"
ctest --preset release --parallel 1 --rerun-failed
