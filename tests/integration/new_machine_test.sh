#!/usr/bin/env bash
# The two commands of README.md, in a new root of a Debian release that has nothing but its smallest packages and the files of HEAD:
# ./comrad train ends at its goal; ./comrad test fails in nothing and skips only what tests/SKIPPED.md lists (CI=true looks at that, and
# at warnings of the compiler).
#
#   new_machine_test.sh RELEASE      bookworm or trixie
#
# Needs root, namespaces, mmdebstrap (deploy/packages_test.txt), a git checkout and a mirror of Debian: the machine's own sources, set
# to that release. pip in the new root has the machine's configuration. Ends with 77 where one of these is missing.
# COMRAD_NEW_MACHINE_TESTS has arguments for the second command: '-L unit'. COMRAD_NEW_MACHINE_ROOT names a folder to keep the new root in,
# build and all, and to take it from the next time.
set -euo pipefail
release="$1"
home="$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/../.." && pwd)"
scratch="$(mktemp -d)"
root="${COMRAD_NEW_MACHINE_ROOT:-${scratch}/root}"
trap 'rm -rf --one-file-system "${scratch}"' EXIT
# shellcheck source=deploy/package/root.sh
source "${home}/deploy/package/root.sh"

say() { echo "new_machine_test, ${release}: $*"; }
fail() {
  say "$*" >&2
  exit 1
}
skip() {
  echo "[  SKIPPED ] 1 test, the two commands on ${release}: $*"
  exit 77
}

why="$(why_no_root)"
[[ -z "${why}" ]] || skip "${why}"
git -c safe.directory="${home}" -C "${home}" archive HEAD >"${scratch}/sources.tar" 2>/dev/null || skip "${home} is no git checkout"

make_root "${release}" "${root}" || skip "no Debian could be made: ${root_failure}"
give_pip "${root}"
mkdir -p "${root}/root/comrad"
find "${root}/root/comrad" -mindepth 1 -maxdepth 1 ! -name build ! -name train_dir -exec rm -rf {} +
tar -C "${root}/root/comrad" -xf "${scratch}/sources.tar"
rm -rf "${root}/root/comrad/train_dir"

inside() { in_root host "${root}" "${pip_folders[@]}" -- env -C /root/comrad "${pip_environment[@]}" "$@"; }

begin="${SECONDS}"
inside ./comrad train --scenario coop_health_gathering --algo ippo --seed 42 --experiment first --train_for_env_frames 4000 \
  >"${scratch}/train.log" 2>&1 </dev/null || fail "train ended with $?: $(tail -n 40 "${scratch}/train.log")"
grep -q '"state": *"finished"' "${root}/root/comrad/train_dir/first/status.json" || fail "no finished run: $(tail -n 20 "${scratch}/train.log")"
grep '^comrad: ' "${scratch}/train.log"
say "installed, built and trained in $((SECONDS - begin)) s"

begin="${SECONDS}"
read -ra tests <<<"${COMRAD_NEW_MACHINE_TESTS:-}"
code=0
inside CI=true ./comrad test "${tests[@]}" >"${scratch}/test.log" 2>&1 </dev/null || code=$?
sed -n '/^Skipped, in whole or in part:/,$p' "${scratch}/test.log"
((code == 0)) || fail "test ended with ${code}: $(grep -E -A 80 '^comrad: error|\*\*\*Failed|\*\*\*Timeout|\*\*\*Exception' "${scratch}/test.log" || tail -n 60 "${scratch}/test.log")"
grep -qE '^100% tests passed, 0 tests failed out of [1-9]' "${scratch}/test.log" || fail "no test ran: $(tail -n 20 "${scratch}/test.log")"
say "tested in $((SECONDS - begin)) s"
