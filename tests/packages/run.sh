#!/usr/bin/env bash
# Makes Debian packages and lives through the guide's steps with them in a fresh Debian: installs, starts, attaches, opens the
# page, removes, purges, and compares every file there was before with those after. As root.
# usage: tests/packages/run.sh [--built]     --built: with the packages that are in build/debian/packages
set -euo pipefail
cd "$(dirname "$0")/../.."
case ${1:-} in
  --help) sed -n '2,4s/^# //p' "$0"; exit 0 ;;
  --built) ;;
  '') deploy/debian/build.sh ;;
  *) echo "$1 is not known; see --help" >&2; exit 2 ;;
esac
[ "$(id -u)" -eq 0 ] || { echo "a Debian of its own is made as root; run it with sudo" >&2; exit 1; }
# shellcheck source=deploy/packages.sh
. deploy/packages.sh
rustle_install_packages machine
exec /usr/bin/python3 tests/packages/packages_test.py -v
