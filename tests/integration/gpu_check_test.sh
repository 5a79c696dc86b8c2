#!/usr/bin/env bash
# deploy/gpu/check.sh as far as a CPU goes: what fails is reported and the other parts continue; bad input is refused. With the word
# `real`, instead: a dry run with the programs of a build makes both files, with every algorithm compared and every bench's
# settings read.
#
#   gpu_check_test.sh BUILD_FOLDER [real]
set -euo pipefail
build="$1"
check="$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/../.." && pwd)/deploy/gpu/check.sh"
scratch="$(mktemp -d)"
trap 'rm -rf "${scratch}"' EXIT

fail() {
  echo "gpu_check_test: $*" >&2
  exit 1
}
refused() {
  local code=0
  "${check}" "$@" >"${scratch}/refused" 2>&1 || code=$?
  [[ "${code}" == 2 ]] || fail "$* ended with ${code}: $(<"${scratch}/refused")"
}
# look FILE EXPRESSION: what Python prints for the object `r` in a file.
look() {
  python3 -c 'import json, sys; r = json.load(open(sys.argv[1])); assert eval(sys.argv[2]), sys.argv[2]' "$@" || fail "$1: $(<"$1")"
}

if [[ "${2:-}" == real ]]; then
  "${check}" --dry --build "${build}" --out "${scratch}/real" >"${scratch}/log" 2>&1 || fail "dry run: $(<"${scratch}/log")"
  json="${scratch}/real/gpu.json"
  look "${json}" 'all(part["ok"] for part in r["parts"]) and len(r["parts"]) == 20 and r["dry"]'
  look "${json}" 'len(r["parity"]) == 8 and all(p["agrees"] and p["logits_largest_difference"] == 0 for p in r["parity"].values())'
  look "${json}" 'r["bench"][0]["env_frames_per_s"] > 0 and r["training"]["env_frames"] >= 4000 and r["training"]["wall_s"] > 0'
  look "${json}" 'r["training"]["state"] == "finished" and "CPU" in r["libtorch"]["libtorch"]'
  "${check}" --quick --dry --build "${build}" --out "${scratch}/quick" >"${scratch}/log" 2>&1 || fail "quick dry run: $(<"${scratch}/log")"
  look "${scratch}/quick/gpu.json" 'all(part["ok"] for part in r["parts"]) and len(r["parts"]) == 10 and len(r["parity"]) == 8'
  grep -q '^| qplex_q | 0.0e+00 .* yes |$' "${scratch}/real/gpu.md" || fail "$(<"${scratch}/real/gpu.md")"
  exit 0
fi

refused --dry --build "${scratch}" --out "${scratch}/none"
grep -q "bin/comrad" "${scratch}/refused" || fail "it does not say what is missing: $(<"${scratch}/refused")"
refused --fast
refused --seconds
refused --wheels "${scratch}/none" --dry --build "${build}"

# Programs that fail, one of them with half an object on stdout.
mkdir -p "${scratch}/fake/bin"
printf '#!/bin/sh\ncase "$1" in\n  bench) echo "{\\"scenario\\": "; exit 3 ;;\n  *) echo "{}" ;;\nesac\n' >"${scratch}/fake/bin/comrad"
echo 'add_test(device_parity_test sh -c "echo no such device; exit 1")' >"${scratch}/fake/CTestTestfile.cmake"
chmod +x "${scratch}/fake/bin/comrad"
code=0
"${check}" --dry --build "${scratch}/fake" --out "${scratch}/broken" >"${scratch}/log" 2>&1 || code=$?
[[ "${code}" == 1 ]] || fail "parts failed, and it ended with ${code}: $(<"${scratch}/log")"
grep -q "parity failed (exit code 8)" "${scratch}/log" || fail "it does not name what failed: $(<"${scratch}/log")"
grep -q "no such device" "${scratch}/broken/parts/parity.out" || fail "the test's words are lost: $(<"${scratch}/broken/parts/parity.out")"
look "${scratch}/broken/gpu.json" \
  '{part["name"] for part in r["parts"] if not part["ok"]} == {"parity", "bench_stag_hunt_arena_mappo"} and len(r["parts"]) == 20'
grep -q '| parity | \*\*failed\*\* |' "${scratch}/broken/gpu.md" || fail "$(<"${scratch}/broken/gpu.md")"
