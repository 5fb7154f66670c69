#!/usr/bin/env bash
# Puts the Blender add-on together, with the Python SDK in it: FOLDER/rustle_blender, and FOLDER/rustle_blender.zip to install.
# usage: client_sdk/blender/package.sh FOLDER
set -euo pipefail
if [ $# -ne 1 ] || [ "$1" = --help ]; then
  sed -n '2,3s/^# //p' "$0"
  [ "${1:-}" = --help ] && exit 0
  exit 2
fi
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "$1"
folder=$(cd "$1" && pwd)
rm -rf "$folder/rustle_blender" "$folder/rustle_blender.zip"
mkdir "$folder/rustle_blender"
cp "$here"/rustle_blender/*.py "$folder/rustle_blender/"
"$here/../python/assemble.sh" "$folder/rustle_blender/sdk"
rm "$folder/rustle_blender/sdk/pyproject.toml"
cd "$folder" && python3 -m zipfile -c rustle_blender.zip rustle_blender
