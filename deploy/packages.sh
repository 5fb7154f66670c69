# The Debian 12 packages Rustle needs; sourced by quickstart.sh and tests/run.sh.
# rustle_install_packages build|test|bench|fuzz|blender|container|packages|machine|slurm: installs what is missing, with sudo where the caller is not root.

rustle_build_packages=(
  g++ cmake ninja-build ccache pkg-config git ca-certificates
  libzmq3-dev cppzmq-dev libprotobuf-dev protobuf-compiler libeigen3-dev libfftw3-dev libsamplerate0-dev libsndfile1-dev libmysofa-dev
  libspdlog-dev libfmt-dev libcli11-dev libexpected-dev nlohmann-json3-dev libtomlplusplus-dev librtaudio-dev libjack-jackd2-dev
  libboost-dev prometheus-cpp-dev libcairo2-dev libopus-dev libzstd-dev liblz4-dev zlib1g-dev fonts-dejavu-core
)
rustle_test_packages=(catch2 chromium clang-format libclang-rt-19-dev nodejs npm python3 python3-numpy python3-zmq python3-protobuf python3-pip python3-setuptools python3-wheel pulseaudio pulseaudio-utils jackd2
  libbullet-dev parallel python3-yaml python3-jsonschema iproute2)
rustle_fuzz_packages=(clang-19 libclang-rt-19-dev catch2)
rustle_bench_packages=(supercollider-server)  # what the benchmarks compare with
rustle_container_packages=(mmdebstrap buildah)  # for deploy/container/build.sh
rustle_package_packages=(dpkg-dev lintian nodejs npm python3)  # for deploy/debian/build.sh
rustle_machine_packages=(mmdebstrap systemd systemd-container python3 python3-numpy)  # for tests/packages/run.sh
rustle_slurm_packages=(slurm-wlm munge parallel python3 python3-numpy)  # for tests/slurm/run.sh
rustle_blender_packages=(blender protobuf-compiler python3 python3-numpy python3-zmq python3-protobuf)  # for tests/blender/run.sh

rustle_install_packages() {
  local wanted=("${rustle_build_packages[@]}") missing=() name as_root=()
  [ "$1" = test ] && wanted+=("${rustle_test_packages[@]}")
  [ "$1" = fuzz ] && wanted+=("${rustle_fuzz_packages[@]}")
  [ "$1" = bench ] && wanted+=("${rustle_bench_packages[@]}")
  [ "$1" = container ] && wanted+=("${rustle_container_packages[@]}")
  [ "$1" = packages ] && wanted+=("${rustle_package_packages[@]}")
  [ "$1" = blender ] && wanted=("${rustle_blender_packages[@]}")
  [ "$1" = machine ] && wanted=("${rustle_machine_packages[@]}")
  [ "$1" = slurm ] && wanted=("${rustle_slurm_packages[@]}")
  for name in "${wanted[@]}"; do
    # A newer Node.js from elsewhere serves as well as Debian's.
    case $name in nodejs) command -v node >/dev/null && continue ;; npm) command -v npm >/dev/null && continue ;; esac
    dpkg-query -W -f='${Status}' "$name" 2>/dev/null | grep -q '^install ok installed$' || missing+=("$name")
  done
  [ ${#missing[@]} -eq 0 ] && return 0
  echo "installing ${#missing[@]} Debian packages: ${missing[*]}"
  if [ "$(id -u)" -ne 0 ]; then
    command -v sudo >/dev/null || {
      echo "these packages are missing and sudo is not there to install them; as root: apt-get install ${missing[*]}" >&2
      return 1
    }
    as_root=(sudo)
  fi
  "${as_root[@]}" apt-get update -qq &&
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
}
