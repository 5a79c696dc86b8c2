#!/usr/bin/env bash
# The two commands of README.md, in a new root of a Debian release that has nothing but its smallest packages and the files of HEAD:
# ./comrad train ends at its goal; ./comrad test fails in nothing and skips only what tests/SKIPPED.md lists (CI=true looks at that, and
# at warnings of the compiler).
#
#   stranger_test.sh RELEASE      bookworm or trixie
#
# Needs root, namespaces, mmdebstrap (deploy/packages_test.txt), a git checkout and a mirror of Debian: the machine's own sources, set
# to that release. pip in the new root has the machine's configuration. Ends with 77 where one of these is missing.
# COMRAD_STRANGER_TESTS has arguments for the second command: '-L unit'. COMRAD_STRANGER_ROOT names a folder to keep the new root in,
# build and all, and to take it from the next time.
set -euo pipefail
release="$1"
home="$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/../.." && pwd)"
scratch="$(mktemp -d)"
root="${COMRAD_STRANGER_ROOT:-${scratch}/root}"
trap 'rm -rf --one-file-system "${scratch}"' EXIT

say() { echo "stranger_test, ${release}: $*"; }
fail() {
  say "$*" >&2
  exit 1
}
skip() {
  echo "[  SKIPPED ] 1 test, the two commands on ${release}: $*"
  exit 77
}

((EUID == 0)) || skip "only root may make another root folder"
command -v mmdebstrap >/dev/null || skip "mmdebstrap is not installed; ./comrad test installs it"
unshare --mount --pid --fork true 2>/dev/null || skip "namespaces are not permitted here"
git -c safe.directory="${home}" -C "${home}" archive HEAD >"${scratch}/sources.tar" 2>/dev/null || skip "${home} is no git checkout"

if [[ ! -x "${root}/usr/bin/apt-get" ]]; then
  sources=(/etc/apt/sources.list.d/debian.sources)
  [[ -f "${sources[0]}" ]] || sources=(/etc/apt/sources.list)
  this="$(. /etc/os-release && echo "${VERSION_CODENAME}")"
  sed "s/\\b${this}\\b/${release}/g" "${sources[0]}" >"${scratch}/$(basename "${sources[0]}")"
  mmdebstrap --quiet --variant=minbase "${release}" "${root}" "${scratch}/$(basename "${sources[0]}")" >"${scratch}/root.log" 2>&1 ||
    skip "no Debian could be made: $(tail -n 1 "${scratch}/root.log")"
fi
cp /etc/resolv.conf /etc/hosts "${root}/etc/"
mkdir -p "${root}/root/comrad"
find "${root}/root/comrad" -mindepth 1 -maxdepth 1 ! -name build ! -name train_dir -exec rm -rf {} +
tar -C "${root}/root/comrad" -xf "${scratch}/sources.tar"
rm -rf "${root}/root/comrad/train_dir"

# pip as it is configured here: files, variables, certificates, folders of wheels.
[[ ! -f /etc/pip.conf ]] || cp /etc/pip.conf "${root}/etc/"
[[ ! -d /etc/xdg/pip ]] || { mkdir -p "${root}/etc/xdg" && cp -r /etc/xdg/pip "${root}/etc/xdg/"; }
mapfile -t environment < <(env | grep -iE '^(PIP_[A-Z_]+|[a-z]+_proxy)=' || true)
if [[ -f "${PIP_CERT:-}" ]]; then
  cp "${PIP_CERT}" "${root}/root/pip.crt"
  environment+=(PIP_CERT=/root/pip.crt)
fi
read -ra wheels <<<"${PIP_FIND_LINKS:-}"

inside() { # in the new root's sources, with its own processes and mounts
  # shellcheck disable=SC2016
  unshare --mount --pid --fork --kill-child bash -c 'root="$1"; shift
    mount --bind "${root}" "${root}" && # tests change how mounts spread, which only a mount point can
      mount -t proc proc "${root}/proc" && mount --rbind /sys "${root}/sys" && mount --rbind /dev "${root}/dev" &&
      mount -t tmpfs tmpfs "${root}/dev/shm" && mount -t tmpfs tmpfs "${root}/run" || exit
    while [[ "$1" != -- ]]; do
      [[ ! -d "$1" ]] || { mkdir -p "${root}/$1" && mount --bind -o ro "$1" "${root}/$1"; } || exit
      shift
    done
    exec chroot "${root}" env -i -C /root/comrad "${@:2}"' inside "${root}" "${wheels[@]}" -- \
    HOME=/root PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin "${environment[@]}" "$@"
}

begin="${SECONDS}"
inside ./comrad train --scenario coop_health_gathering --algo ippo --seed 42 --experiment first --train_for_env_frames 4000 \
  >"${scratch}/train.log" 2>&1 </dev/null || fail "train ended with $?: $(tail -n 40 "${scratch}/train.log")"
grep -q '"state": *"finished"' "${root}/root/comrad/train_dir/first/status.json" || fail "no finished run: $(tail -n 20 "${scratch}/train.log")"
grep '^comrad: ' "${scratch}/train.log"
say "installed, built and trained in $((SECONDS - begin)) s"

begin="${SECONDS}"
read -ra tests <<<"${COMRAD_STRANGER_TESTS:-}"
code=0
inside CI=true ./comrad test "${tests[@]}" >"${scratch}/test.log" 2>&1 </dev/null || code=$?
sed -n '/^Skipped, in whole or in part:/,$p' "${scratch}/test.log"
((code == 0)) || fail "test ended with ${code}: $(grep -E -A 80 '^comrad: error|\*\*\*Failed|\*\*\*Timeout|\*\*\*Exception' "${scratch}/test.log" || tail -n 60 "${scratch}/test.log")"
grep -qE '^100% tests passed, 0 tests failed out of [1-9]' "${scratch}/test.log" || fail "no test ran: $(tail -n 20 "${scratch}/test.log")"
say "tested in $((SECONDS - begin)) s"
