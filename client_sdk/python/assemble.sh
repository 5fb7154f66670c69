#!/usr/bin/env bash
# Puts the Python package together: the SDK's modules and the messages that protoc makes of proto/rustle/v1.
# usage: client_sdk/python/assemble.sh FOLDER
# Then: PYTHONPATH=FOLDER python3, or pip install --no-build-isolation FOLDER
set -euo pipefail
if [ $# -ne 1 ] || [ "$1" = --help ]; then
  sed -n '2,4s/^# //p' "$0"
  [ "${1:-}" = --help ] && exit 0
  exit 2
fi
here=$(cd "$(dirname "$0")" && pwd)
proto=$(cd "$here/../../proto" && pwd)
mkdir -p "$1/rustle/v1"
folder=$(cd "$1" && pwd)
cp "$here"/pyproject.toml "$1/"
cp "$here"/rustle/*.py "$here"/rustle/py.typed "$1/rustle/"
: >"$1/rustle/v1/__init__.py"
cd "$proto"
"${PROTOC:-protoc}" --proto_path=. --python_out="$folder" --pyi_out="$folder" rustle/v1/*.proto
