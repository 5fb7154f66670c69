#!/usr/bin/env bash
# Checks the wire and captures against what others hold: buf's lint, buf's comparison with the stored image of version 1,
# and captures (the stored one and those given) in the official MCAP readers.
# usage: tests/wire/check_wire.sh [CAPTURE.mcap...]
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
if [ "${1:-}" = --help ]; then
  sed -n '2,4s/^# //p' "$0"
  exit 0
fi
captures=("$root/tests/golden/capture/v1_small.mcap")
for capture in "$@"; do
  captures+=("$(realpath "$capture")")
done

if [ ! -x "$here/node_modules/.bin/buf" ] || [ ! -d "$here/node_modules/@mcap/core" ]; then
  npm ci --prefix "$here" --no-audit --no-fund --loglevel=error
fi
buf=$here/node_modules/.bin/buf
cd "$root/proto"
echo "buf lint"
"$buf" lint
echo "buf breaking, against version 1"
"$buf" breaking --against "$root/tests/golden/wire/rustle.v1.binpb"
echo "captures in the official readers"
node "$here/check_mcap.mjs" "${captures[@]}"
