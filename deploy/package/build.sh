#!/usr/bin/env bash
# The Debian package, made in a separate Debian of the release that it is for:
#
#   deploy/package/build.sh [RELEASE] [FOLDER]      bookworm (default) or trixie; where it is put (default: dist/RELEASE)
#
# It is built from this checkout's files, without a network once the packages of packages.txt are there, with this machine's ccache. Needs
# root, mmdebstrap and a mirror of Debian. COMRAD_BUILD_ROOT names a folder to keep the Debian in, and to take it from the next time.
set -euo pipefail
home="$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/../.." && pwd)"
release="${1:-bookworm}"
out="$(realpath -m -- "${2:-dist/${release}}")"
scratch="$(mktemp -d)"
root="${COMRAD_BUILD_ROOT:-${scratch}/root}"
trap 'rm -rf --one-file-system "${scratch}"' EXIT
# shellcheck source=deploy/package/root.sh
source "${home}/deploy/package/root.sh"
fail() {
  echo "build.sh: $*" >&2
  exit 1
}

[[ "${release}" == bookworm || "${release}" == trixie ]] || fail "${release}: packages are for bookworm (Debian 12) and trixie (13)"
why="$(why_no_root)"
[[ -z "${why}" ]] || fail "${why}"
mapfile -t packages < <(packages_of packages.txt)
make_root "${release}" "${root}" dpkg-dev file "${packages[@]}" || fail "no Debian could be made: ${root_failure}"
mkdir -p "${out}"
copy_sources "${home}" "${root}/${home}" # the same path as here, for ccache

# shellcheck disable=SC2016
in_root none "${root}" "${ccache_bind[@]}" "${out}:/dist" -- CMAKE_BUILD_PARALLEL_LEVEL="${COMRAD_JOBS:-$(nproc)}" bash -euc '
  cd "$1"
  cmake -S . -B build -G Ninja
  cmake --build build --target tools
  rm -rf /tmp/package &&   cpack --config build/CPackConfig.cmake -B /tmp/package
  cp /tmp/package/comrad_*.deb /dist' build "${home}"
for package in "${out}"/comrad_*.deb; do
  echo "$(basename "${package}") for ${release}: $(stat -c %s "${package}") bytes, $(dpkg-deb --field "${package}" Installed-Size) KiB installed"
done
