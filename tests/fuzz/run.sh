#!/usr/bin/env bash
# Fuzzes every target with AddressSanitizer and UndefinedBehaviorSanitizer, and prints a line each: executions, features, faults.
# usage: tests/fuzz/run.sh [--runs N] [--seconds S] [TARGET ...]
#   --runs      executions of each [10000000; 1000000 of the loaders of files: capture, pack, configuration]
#   --seconds   the longest that one target may take, whatever the executions [no limit]
# What it finds is in build/fuzz/found/TARGET; put it into tests/fuzz/corpus/TARGET with the mend. Example: tests/fuzz/run.sh --seconds 60 frame
set -euo pipefail
cd "$(dirname "$0")/../.."
runs= seconds=0 targets=()
while [ $# -gt 0 ]; do
  case $1 in
    --help) sed -n '2,6s/^# //p' "$0"; exit 0 ;;
    --runs) runs=$2; shift 2 ;;
    --seconds) seconds=$2; shift 2 ;;
    -*) echo "$1 is not known; see --help" >&2; exit 2 ;;
    *) targets+=("$1"); shift ;;
  esac
done
[ ${#targets[@]} -gt 0 ] || targets=(frame scene control capture pack keys configuration)
# shellcheck source=deploy/packages.sh
. deploy/packages.sh
rustle_install_packages fuzz
cmake --preset fuzz -DCMAKE_CXX_COMPILER_LAUNCHER=ccache --log-level=WARNING
cmake --build --preset fuzz --target "${targets[@]/#/fuzz_}"
# Short stacks and a small quarantine: a report says less, of what is run again anyway, and a third more is run in the same time.
export ASAN_OPTIONS=malloc_context_size=2:quarantine_size_mb=16 UBSAN_OPTIONS=print_stacktrace=1 LSAN_OPTIONS=suppressions=$PWD/tests/support/lsan.supp
faults=0
for target in "${targets[@]}"; do
  grown=build/fuzz/corpus/$target found=build/fuzz/found/$target log=build/fuzz/$target.log
  mkdir -p "$grown" "$found"
  wanted=$runs
  case ${wanted:-$target} in capture | pack | configuration) wanted=1000000 ;; esac
  status=ok
  build/fuzz/tests/fuzz_"$target" -runs="${wanted:-10000000}" -max_total_time="$seconds" -max_len=4096 -timeout=10 -rss_limit_mb=2048 \
    -malloc_limit_mb=512 -print_final_stats=1 -artifact_prefix="$found/" "$grown" tests/fuzz/corpus/"$target" >"$log" 2>&1 || status=FAULT
  [ $status = ok ] || faults=$((faults + 1))
  awk -v target="$target" -v status=$status '/stat::number_of_executed_units/ {executed = $2} /stat::average_exec_per_sec/ {rate = $2}
    / cov: / {for (k = 1; k < NF; ++k) {if ($k == "cov:") covered = $(k + 1); if ($k == "ft:") features = $(k + 1)}}
    END {printf "%-14s %10d executions, %6d a second, %5d edges, %6d features: %s\n", target, executed, rate, covered, features, status}' "$log"
done
[ $faults -eq 0 ] || { echo "what was found is in build/fuzz/found, the reports in build/fuzz/*.log" >&2; exit 1; }
