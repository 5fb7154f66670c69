#!/usr/bin/env bash
# Makes Debian packages: installs what that takes, builds, packs every component by CPack, asks lintian.
# usage: deploy/debian/build.sh [--no-lintian]
# Example: deploy/debian/build.sh && sudo apt install ./build/debian/packages/*.deb
# The packages are in build/debian/packages; lintian's errors are this command's.
set -euo pipefail
cd "$(dirname "$0")/../.."
check=yes
case ${1:-} in
  --help) sed -n '2,5s/^# //p' "$0"; exit 0 ;;
  --no-lintian) check=no ;;
  ?*) echo "$1 is not known; see --help" >&2; exit 2 ;;
esac
# shellcheck source=deploy/packages.sh
. deploy/packages.sh
rustle_install_packages packages
build=build/debian
# Debian's hardening, without debug information; -O3 of the release stays the last word.
export DEB_CFLAGS_MAINT_STRIP="-g -O2" DEB_CXXFLAGS_MAINT_STRIP="-g -O2" DEB_CPPFLAGS_MAINT_STRIP=-Wdate-time DEB_BUILD_MAINT_OPTIONS=hardening=+bindnow
flags=$(dpkg-buildflags --get CPPFLAGS)
cmake --preset debian -DCMAKE_CXX_COMPILER_LAUNCHER=ccache --log-level=WARNING \
  -DCMAKE_C_FLAGS="$(dpkg-buildflags --get CFLAGS) $flags" -DCMAKE_CXX_FLAGS="$(dpkg-buildflags --get CXXFLAGS) $flags" \
  -DCMAKE_EXE_LINKER_FLAGS="$(dpkg-buildflags --get LDFLAGS)" -DCMAKE_SHARED_LINKER_FLAGS="$(dpkg-buildflags --get LDFLAGS)"
cmake --build --preset debian
rm -rf "$build/packages" "$build/_CPack_Packages"
(cd "$build" && umask 022 && cpack -G DEB >cpack.log) || { cat "$build/cpack.log" >&2; exit 1; }
rm -rf "$build/_CPack_Packages" "$build"/packages/_CPack_Packages
if [ $check = yes ]; then
  as=()
  [ "$(id -u)" -ne 0 ] || as=(--allow-root)
  lintian "${as[@]}" --fail-on error --no-tag-display-limit "$build"/packages/*.deb
fi
echo "packages in $build/packages:"
ls -1 "$build/packages"
