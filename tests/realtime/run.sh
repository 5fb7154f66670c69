#!/usr/bin/env bash
# Renders under two watches that stop it when the render path allocates, locks or calls the system: a guard of our own and
# RealtimeSanitizer's runtime. First every watch has to catch what is put there on purpose.
# usage: tests/realtime/run.sh [--blocks N]      blocks of 128 samples of all sessions together, 1000000 by default
# RUSTLE_BUILD: where to build, build/release by default
# example: tests/realtime/run.sh --blocks 100000
set -euo pipefail
cd "$(dirname "$0")/../.."
blocks=1000000
while [ $# -gt 0 ]; do
  case $1 in
    --help | -h)
      sed -n '2,6s/^# //p' tests/realtime/run.sh
      exit
      ;;
    --blocks)
      blocks=${2:-}
      [[ $blocks =~ ^[0-9]+$ ]] || { echo "--blocks wants a number" >&2; exit 2; }
      shift 2
      ;;
    *)
      echo "$1 is not known; tests/realtime/run.sh --help tells what is" >&2
      exit 2
      ;;
  esac
done
# shellcheck source=deploy/packages.sh
. deploy/packages.sh
rustle_install_packages test >&2
build=${RUSTLE_BUILD:-build/release}
launcher=()
command -v ccache >/dev/null && launcher=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
log=$(mktemp)
trap 'rm -f "$log"' EXIT
if ! { cmake -S . -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DRUSTLE_TESTS=ON "${launcher[@]}" &&
  cmake --build "$build" --target render_guard render_rtsan rustle_packs; } >"$log" 2>&1; then
  cat "$log" >&2
  exit 1
fi
for watch in guard rtsan; do
  for violation in allocation free lock system-call; do
    if "$build/tests/render_$watch" --violate "$violation" >"$log" 2>&1; then
      echo "$watch does not see: $violation" >&2
      exit 1
    fi
    if ! grep -qE 'the render path (allocates|frees|calls)|Real-time violation' "$log"; then
      cat "$log" >&2
      exit 1
    fi
    echo "$watch catches: $violation"
  done
  "$build/tests/render_$watch" --blocks "$blocks"
done
