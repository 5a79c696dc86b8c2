#!/usr/bin/env bash
# The wheels of deploy/wheel/build.sh in a new root of a Debian release that has Python and pip and nothing else: pip installs them without a
# network, and wheel_plays.py beside this plays there; at last examples/ppo.py trains for a minute of processor time.
#
#   wheel_test.sh RELEASE FOLDER      bookworm or trixie; FOLDER keeps the wheels between the tests of one commit
#
# Needs what build.sh needs. Ends with 77 where one of these is missing. COMRAD_WHEEL_TEST_ROOT names a folder to keep the new root in, and to
# take it from the next time.
set -euo pipefail
release="$1" made="$2"
home="$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/../.." && pwd)"
scratch="$(mktemp -d)"
root="${COMRAD_WHEEL_TEST_ROOT:-${scratch}/root}"
trap 'rm -rf --one-file-system "${scratch}"' EXIT
# shellcheck source=deploy/package/root.sh
source "${home}/deploy/package/root.sh"

say() { echo "wheel_test, ${release}: $*"; }
fail() {
  say "$*" >&2
  exit 1
}
skip() {
  echo "[  SKIPPED ] 1 test, wheels on ${release}: $*"
  exit 77
}
why="$(why_no_root)"
[[ -z "${why}" ]] || skip "${why}"

make_root "${release}" "${root}" python3 python3-pip || skip "no Debian could be made: ${root_failure}"
made_once "${home}" "${made}" "${home}/deploy/wheel/build.sh" "${made}" || fail "build.sh: $(tail -n 20 "${made}/build.log")"
wheel="$(echo "${made}"/comrad-*.whl)" data="$(echo "${made}"/comrad_freedoom-*.whl)"
bytes="$(stat -c %s "${wheel}")"
say "$(basename "${wheel}") of ${bytes} bytes, $(basename "${data}") of $(stat -c %s "${data}")"
((bytes < 15000000)) || fail "the wheel has more than 15 MB"
[[ "${wheel}" == *-cp311-abi3-manylinux_* ]] || fail "the wheel is not for every Python from 3.11 on and for glibc: ${wheel}"

give_pip "${root}"
rm -rf "${root}/wheels" "${root}/root/plays" && mkdir -p "${root}/wheels" "${root}/root/plays"
cp "${wheel}" "${data}" "${root}/wheels/"
cp "${home}/tests/integration/wheel_plays.py" "${home}/sim_workers/python/examples/ppo.py" "${root}/root/plays/"
# What they need of the index, and what the tests play with, is fetched before the network goes.
pip=(python3 -m pip --disable-pip-version-check)
in_root host "${root}" "${pip_folders[@]}" -- "${pip_environment[@]}" "${pip[@]}" download -q --only-binary :all: --find-links /wheels \
  --dest /wheels comrad vizdoom >"${scratch}/download.log" 2>&1 || skip "pip cannot fetch what the wheels need: $(tail -n 2 "${scratch}/download.log")"
inside() { in_root none "${root}" -- "$@" >"${scratch}/inside.log" 2>&1 </dev/null; }
install=("${pip[@]}" install -q --break-system-packages --no-index --find-links /wheels)
others=()
for file in "${root}"/wheels/*.whl; do
  name="/wheels/$(basename "${file}")"
  [[ "${name}" == /wheels/comrad* || "${name}" == /wheels/vizdoom* ]] || others+=("${name}")
done
inside "${install[@]}" "${others[@]}" || fail "pip install: $(<"${scratch}/inside.log")"
TIMEFORMAT='%R %U %S'
{ time inside "${install[@]}" "/wheels/$(basename "${wheel}")" "/wheels/$(basename "${data}")"; } 2>"${scratch}/time" ||
  fail "pip install: $(<"${scratch}/inside.log")"
say "installed in $(awk 'END { print $1 " s, " $2 + $3 " s of processor time" }' "${scratch}/time")"
awk 'END { exit $2 + $3 >= 10 }' "${scratch}/time" || fail "pip install took more than 10 s"

inside python3 -B /root/plays/wheel_plays.py || fail "wheel_plays.py: $(tail -n 40 "${scratch}/inside.log")"
cat "${scratch}/inside.log"

# PyTorch is no part of the wheel: Debian's, or where that one is too old for today's NumPy, PyPI's.
if [[ "${release}" == bookworm ]]; then
  in_root host "${root}" "${pip_folders[@]}" -- "${pip_environment[@]}" "${pip[@]}" install -q --break-system-packages torch==2.13.0 vizdoom
else
  in_root host "${root}" "${pip_folders[@]}" -- "${pip_environment[@]}" sh -c 'apt-get update -q && apt-get install -q -y --no-install-recommends python3-torch
    python3 -m pip install -q --break-system-packages --no-index --find-links /wheels --no-deps vizdoom'
fi >"${scratch}/torch.log" 2>&1 || skip "no PyTorch: $(tail -n 2 "${scratch}/torch.log")"
# shellcheck disable=SC2016
inside env OMP_NUM_THREADS=1 sh -c '(ulimit -S -t 60 && exec python3 -B -u /root/plays/ppo.py --decisions 100000000); test $? = 152' ||
  fail "ppo.py ends before the limit of processor time ends it: $(tail -n 20 "${scratch}/inside.log")"
grep -qE '[0-9]+ decisions, return' "${scratch}/inside.log" || fail "ppo.py learned nothing in a minute: $(<"${scratch}/inside.log")"
say "ppo.py: $(grep -E '[0-9]+ decisions, return' "${scratch}/inside.log" | tail -n 1)"
