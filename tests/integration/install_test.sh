#!/usr/bin/env bash
# `cmake --install` into a prefix that is moved afterwards: its programs find each other and their data there, with an empty
# environment, and no longer look at the sources.
#
#   install_test.sh BUILD_FOLDER
set -euo pipefail
build="$1"
home="$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/../.." && pwd)"
scratch="$(mktemp -d)"
trap 'rm -rf "${scratch}"' EXIT

fail() {
  echo "install_test: $*" >&2
  exit 1
}

cmake --install "${build}" --prefix "${scratch}/first" >"${scratch}/install.log" || fail "$(tail -n 5 "${scratch}/install.log")"
mkdir -p "${scratch}/moved/far"
mv "${scratch}/first" "${scratch}/moved/far/comrad"
prefix="${scratch}/moved/far/comrad"
cd "${scratch}"
installed() { env -i "${prefix}/bin/comrad" "$@"; }

for program in "${prefix}"/libexec/comrad/*; do
  path="$(readelf -d "${program}" | grep -E '\((RPATH|RUNPATH)\)' || true)"
  [[ "${path}" != *"${build}"* && "${path}" != *"${home}"* ]] || fail "${program} looks for libraries in ${path}"
done

# A scenario that only the prefix has.
cp -r "${home}/tests/integration/target_room" "${prefix}/share/comrad/scenarios/target_room"
names() { sed 's/ .*//' "$1"; }
installed scenarios list >"${scratch}/scenarios.txt"
COMRAD_HOME="${home}" "${build}/bin/comrad" scenarios list >"${scratch}/of_sources.txt"
[[ "$(names "${scratch}/scenarios.txt")" == "$( (echo target_room && names "${scratch}/of_sources.txt") | LC_ALL=C sort)" ]] ||
  fail "the prefix has other scenarios than the sources and its own: $(<"${scratch}/scenarios.txt")"

small=(--scenario coop_health_gathering --algo ippo --seed 42 --num_workers 1 --num_envs_per_worker 4 --rollout 16
  --batch_size 256 --micro_batch_size 64 --num_epochs 1 --rnn_type gru --rnn_size 32 --device cpu
  --train_dir "${scratch}/runs" --experiment first --train_for_env_frames 4096)
installed train "${small[@]}" >"${scratch}/train.log" 2>&1 || fail "train: $(tail -n 20 "${scratch}/train.log")"
grep -q '"state": *"finished"' "${scratch}/runs/first/status.json" || fail "no finished run: $(<"${scratch}/runs/first/status.json")"
installed eval --policy "${scratch}/runs/first" --episodes 2 --json >"${scratch}/eval.json" 2>"${scratch}/eval.log" ||
  fail "eval: $(tail -n 20 "${scratch}/eval.log")"
grep -q '"episodes": *2' "${scratch}/eval.json" || fail "eval printed $(<"${scratch}/eval.json")"

# A sweep runs, too; a repository that the prefix lies in is not taken for COMRAD's.
git init --quiet "${scratch}/moved"
git -C "${scratch}/moved" -c user.name=x -c user.email=x@localhost commit --quiet --allow-empty --message=x
cat >"${scratch}/study.toml" <<SWEEP
name = "study"
train_dir = "${scratch}/runs"
[axes]
seed = [1]
[settings]
scenario = "coop_health_gathering"
rnn_size = 32
batch_size = 256
micro_batch_size = 64
rollout = 16
num_envs_per_worker = 4
train_for_env_frames = 4000
SWEEP
installed sweep "${scratch}/study.toml" >"${scratch}/sweep.log" 2>&1 || fail "sweep: $(tail -n 20 "${scratch}/sweep.log")"
grep -q '"commit": *""' "${scratch}/runs/study/sweep.json" || fail "of which commit is it? $(<"${scratch}/runs/study/sweep.json")"

# Doctor requests nothing that only a build or the tests need, and names no ./comrad. This dpkg lists no package.
mkdir "${scratch}/bin"
printf '#!/bin/sh\n' >"${scratch}/bin/dpkg-query"
chmod +x "${scratch}/bin/dpkg-query"
env -i PATH="${scratch}/bin:/usr/bin:/bin" "${prefix}/bin/comrad" doctor --json >"${scratch}/doctor.json" || true
grep -q 'missing: python3' "${scratch}/doctor.json" || fail "doctor looks for no packages: $(<"${scratch}/doctor.json")"
if grep -q './comrad' "${scratch}/doctor.json"; then fail "doctor names ./comrad, which is not here: $(<"${scratch}/doctor.json")"; fi
grep -q '"iwad"' "${scratch}/doctor.json" || fail "doctor printed $(<"${scratch}/doctor.json")"
if grep -qE '"(packages|test packages|test python)"' "${scratch}/doctor.json"; then fail "doctor looks for the sources"; fi
# The programs that draw and export come along.
python3 -B -m py_compile "${prefix}"/share/comrad/deploy/{report,sweep}/*.py || fail "reports and searches do not come along"
[[ -f "${prefix}/share/comrad/deploy/sweeps/benchmark.toml" ]] || fail "the paper's sweep does not come along"
if installed test >"${scratch}/test.log" 2>&1; then fail "an installed program has no tests"; fi
grep -q 'run ./comrad test from the sources' "${scratch}/test.log" || fail "test: $(<"${scratch}/test.log")"

# Without its data it names the folder, and does not fall back on the sources.
rm -rf "${prefix}/share/comrad"
if installed train "${small[@]}" --experiment second >"${scratch}/train.log" 2>&1; then fail "it trains without its data"; fi
grep -q "none found below ${prefix}/share/comrad/scenarios" "${scratch}/train.log" || fail "no data: $(<"${scratch}/train.log")"
