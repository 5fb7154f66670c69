#!/usr/bin/env bash
# Installs Debian's Slurm where it is missing and renders a batch on a cluster of this one machine.
# usage: tests/slurm/run.sh [BUILD_FOLDER]     build/release when absent
set -euo pipefail
cd "$(dirname "$0")/../.."
if [ "${1:-}" = --help ]; then
  sed -n '2,3s/^# //p' "$0"
  exit 0
fi
# shellcheck source=deploy/packages.sh
. deploy/packages.sh
rustle_install_packages slurm
RUSTLE_BUILD=$(realpath "${1:-build/release}") exec /usr/bin/python3 tests/e2e/batch_test.py -v
