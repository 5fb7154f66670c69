#!/usr/bin/env bash
# Installs Debian's Blender where it is missing (about 550 MB on the disk) and runs the add-on's tests in it, without a window.
# usage: tests/blender/run.sh [BUILD_FOLDER]     build/release when absent
set -euo pipefail
cd "$(dirname "$0")/../.."
if [ "${1:-}" = --help ]; then
  sed -n '2,3s/^# //p' "$0"
  exit 0
fi
# shellcheck source=deploy/packages.sh
. deploy/packages.sh
rustle_install_packages blender
RUSTLE_BUILD=$(realpath "${1:-build/release}") exec /usr/bin/python3 tests/e2e/blender_test.py -v
