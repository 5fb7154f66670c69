#!/usr/bin/env bash
# Builds a container image of rustled from Debian's packages: no shell, a user without rights, nothing that it writes but
# /var/lib/rustle.
# usage: deploy/container/build.sh [--archive FILE] [NAME]     NAME: rustle:VERSION by default; --archive: for `podman load`
# Example: deploy/container/build.sh
#   rustle keys new server --folder server-keys
#   podman run --rm --read-only --cap-drop all --security-opt no-new-privileges -v rustle:/var/lib/rustle:U \
#     -v ./server-keys:/etc/rustle/keys:ro,U -p 127.0.0.1:7390-7392:7390-7392 rustle
set -euo pipefail
cd "$(dirname "$0")/../.."
archive= name=
while [ $# -gt 0 ]; do
  case $1 in
    --help) sed -n '2,8s/^# //p' "$0"; exit 0 ;;
    --archive) archive=$2; shift 2 ;;
    -*) echo "$1 is not known; see --help" >&2; exit 2 ;;
    *) name=$1; shift ;;
  esac
done
# shellcheck source=deploy/packages.sh
. deploy/packages.sh
rustle_install_packages container
build=build/release
cmake --preset release -DCMAKE_CXX_COMPILER_LAUNCHER=ccache --log-level=WARNING
cmake --build --preset release --target rustled rustle_packs rustle_manual_pages
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
for component in daemon packs; do
  DESTDIR=$work/installed cmake --install "$build" --prefix /usr --component "$component" --strip >/dev/null
done

# The packages that the program's libraries are from, with what those need, unpacked and not configured.
packages=$(ldd "$work/installed/usr/bin/rustled" | awk '/=> \// {print $3}' | while read -r library; do
  dpkg-query -S "*/$(basename "$library")" | cut -d: -f1
done | sort -u | paste -sd, -)
echo "unpacking $(tr , '\n' <<<"$packages" | wc -l) Debian packages and what they need"
mmdebstrap --quiet --variant=extract --include="$packages" bookworm "$work/root"
rm -rf "$work/root"/var/{cache,lib/{apt,dpkg}} "$work/root"/etc/{apt,dpkg} "$work/root"/usr/share/{doc,man,locale,lintian,bug}
rm -rf "$work"/installed/usr/{etc,lib,share/{man,bash-completion,zsh,fish}}  # for who has a shell and a service manager
cp -a "$work/installed/usr" "$work/root/"
mkdir -p "$work/root/etc/rustle/keys" "$work/root/tmp" "$work/root/var/lib/rustle"
cp deploy/container/rustled.toml "$work/root/etc/rustle/"
chmod 1777 "$work/root/tmp"
chown -R 65532:65532 "$work/root/var/lib/rustle"

name=${name:-rustle:$("$build/bin/rustled" --version | cut -d' ' -f2)}
buildah bud --quiet --isolation chroot --tag "$name" --tag rustle --file deploy/container/Containerfile "$work"
[ -z "$archive" ] || buildah push --quiet "$name" "docker-archive:$archive:$name"
echo "image $name, $(du -sh "$work/root" | cut -f1)${archive:+, in $archive}"
