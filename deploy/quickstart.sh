#!/usr/bin/env bash
# From a fresh Debian 12 to the demo: installs packages, builds, runs `rustle demo`.
# usage: deploy/quickstart.sh [arguments of rustle demo]
set -euo pipefail
cd "$(dirname "$0")/.."
if [ "${1:-}" = --help ]; then
  sed -n '2,3s/^# //p' "$0"
  exit 0
fi
# shellcheck source=deploy/packages.sh
. deploy/packages.sh
rustle_install_packages build
cmake --preset release -DRUSTLE_TESTS=OFF -DCMAKE_CXX_COMPILER_LAUNCHER=ccache --log-level=WARNING
cmake --build --preset release
build/release/bin/rustle demo "$@"
