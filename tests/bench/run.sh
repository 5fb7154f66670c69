#!/usr/bin/env bash
# Builds a group of benchmarks in Release and runs it.
# usage: tests/bench/run.sh GROUP [--json] [--check] [--frames N]
# GROUP: analysis (geometry of one frame, stage by stage, beside the plain dihedral pass),
#        server (a frame's way from the simulator to the listener, through the daemon, in real time; then what
#        `rustle load` finds: cost per session, a hundred on one core, a surge, a heavy one beside fifteen; 5 minutes),
#        synthesis (voices beside SuperCollider's, friction, silence; installs supercollider-server where it is missing)
#        cloth (features of units, selection among 54,000, a second of cloth from mesh to sound)
# RUSTLE_BUILD: where to build, build/release by default
# example: tests/bench/run.sh analysis --json
set -euo pipefail
cd "$(dirname "$0")/../.."
if [ $# -eq 0 ] || [ "$1" = --help ] || [ "$1" = -h ]; then
  sed -n '2,11s/^# //p' tests/bench/run.sh
  [ $# -gt 0 ]
  exit
fi
group=$1
shift
if [ ! -f "tests/bench/$group.cpp" ]; then
  groups=$(cd tests/bench && ls ./*.cpp | sed 's|^\./||; s|\.cpp$||' | tr '\n' ' ')
  echo "no benchmarks named '$group'; there are: $groups" >&2
  exit 2
fi
if [ "$group" = synthesis ]; then
  . deploy/packages.sh
  rustle_install_packages bench >&2 || echo "going on without what could not be installed" >&2
fi
programs=
[ "$group" = server ] && programs="rustle rustled rustle_packs"
[ "$group" = cloth ] && programs=rustle_packs
build=${RUSTLE_BUILD:-build/release}
launcher=()
command -v ccache >/dev/null && launcher=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
log=$(mktemp)
trap 'rm -f "$log"' EXIT
if ! { cmake --preset release -B "$build" -DRUSTLE_TESTS=ON "${launcher[@]}" &&
  cmake --build "$build" --target "bench_$group" ${programs:+$programs}; } >"$log" 2>&1; then
  cat "$log" >&2
  exit 1
fi
status=0
"$build/bench/bench_$group" "$@" || status=$?
if [ "$group" = server ] && [ "$status" -eq 0 ]; then
  /usr/bin/python3 tests/bench/server_load.py "$build/bin/rustle" "$@" || status=$?
fi
exit "$status"
