#!/usr/bin/env bash
# Checks the page in headless Chromium against a daemon that is made up, and its parts by themselves.
# usage: tests/page/check_page.sh [arguments of node --test]
# The page is that in RUSTLE_PAGE_PATH, else that of the build in RUSTLE_BUILD; where there is none, server/page/web is built first.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
web=$(cd "$here/../../server/page/web" && pwd)
if [ "${1:-}" = --help ]; then
  sed -n '2,4s/^# //p' "$0"
  exit 0
fi
for program in npm "${CHROMIUM:-chromium}"; do
  if ! command -v "$program" >/dev/null; then
    echo "skipped: $program is not there; apt-get install npm chromium"
    exit 77
  fi
done

install() {
  [ "$1/node_modules/.package-lock.json" -nt "$1/package-lock.json" ] || npm ci --prefix "$1" --no-audit --no-fund --loglevel=error
}
install "$web"
install "$here"
page=${RUSTLE_PAGE_PATH:-${RUSTLE_BUILD:-}/share/rustle/page}
if [ ! -f "$page/index.html" ]; then
  page=$web/dist
  npm run --silent build --prefix "$web" -- --logLevel warn
fi
export RUSTLE_PAGE_PATH=$page
CHROMIUM=$(command -v "${CHROMIUM:-chromium}")
export CHROMIUM
exec node --test --test-concurrency=1 "$@" "$here"/*_test.mjs
