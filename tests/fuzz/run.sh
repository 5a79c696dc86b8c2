#!/usr/bin/env bash
# Builds the libFuzzer targets and runs one of them for so many seconds, from seeds that our own code writes.
#   tests/fuzz/run.sh TARGET SECONDS [BUILD_FOLDER]      TARGET: wad textmap decorate behavior machine picture config link frames join,
#                                                        or build, which only builds
# Ends with libFuzzer's line of executions and coverage; a finding is left in BUILD_FOLDER/findings, printed with its report, and
# ends it with 1. All that libFuzzer said is in BUILD_FOLDER/TARGET.log. 77: there is no libFuzzer, nothing was run.
set -euo pipefail

home="$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/../.." && pwd)"
target="${1:?target}"
seconds="${2:?seconds}"
build="${3:-${home}/build/fuzz}"

skip() {
  printf '%s\n[  SKIPPED ] 1 test: fuzz_%s\n' "$1" "${target}"
  exit 77
}

clang="$(command -v "${COMRAD_CLANG:-clang++}" || true)"
[[ -n "${clang}" ]] || skip "clang++ is not installed (deploy/packages_test.txt; ./comrad test installs it), so libFuzzer cannot run"
probe="$(mktemp -d)"
trap 'rm -rf "${probe}"' EXIT
printf 'extern "C" int LLVMFuzzerTestOneInput(const unsigned char*, unsigned long) { return 0; }\n' >"${probe}/probe.cc"
"${clang}" -fsanitize=fuzzer,address,undefined "${probe}/probe.cc" -o "${probe}/probe" 2>/dev/null ||
  skip "clang++ has no libFuzzer (libclang-rt-dev of deploy/packages_test.txt), so the fuzzers cannot be built"

mkdir -p "${build}/findings"
(
  flock 9
  if [[ ! -f "${build}/build.ninja" ]]; then
    cmake -S "${home}" -B "${build}" -G Ninja -DCMAKE_CXX_COMPILER="${clang}" -DCMAKE_C_COMPILER="${clang%++}" \
      -DCOMRAD_FUZZ=ON -DCOMRAD_GL=OFF \
      -DCOMRAD_PARTS="rollout_buffer;doomgen;scenarios;sim_workers" >"${build}/configure.log" 2>&1 ||
      { cat "${build}/configure.log"; exit 1; }
  fi
  ninja -C "${build}" fuzzers >"${build}/build.log" 2>&1 || { tail -n 60 "${build}/build.log"; exit 1; }
  "${build}/bin/fuzz_seeds" "${build}/seeds"
) 9>"${build}/.lock"
[[ "${target}" != build ]] || exit 0

corpus="${build}/corpus/${target}"
log="${build}/${target}.log"
mkdir -p "${corpus}"
export UBSAN_OPTIONS="print_stacktrace=1:halt_on_error=1" SPDLOG_LEVEL=off
# A failed check or an exception would end libFuzzer with 77, which means "skipped" here: error_exitcode makes a failure of it.
if "${build}/bin/fuzz_${target}" "${corpus}" "${build}/seeds/${target}" -max_total_time="${seconds}" -timeout=20 \
  -rss_limit_mb=3072 -print_final_stats=1 -print_funcs=0 -close_fd_mask=1 -error_exitcode=1 \
  -artifact_prefix="${build}/findings/${target}-" >"${log}" 2>&1; then
  grep -E '^(INFO: Seed|Done|stat::)|DONE' "${log}"
  exit 0
fi
# The report stands behind thousands of lines about coverage; with it the finding itself, for a machine that keeps no files.
grep -E '^INFO: Seed' "${log}" || true
sed -n '/ERROR: \|runtime error: \|terminate called/,$p' "${log}"
finding="$(sed -n 's/^.*Test unit written to //p' "${log}" | tail -n 1)"
if [[ -f "${finding}" ]]; then
  printf 'the input: %s, again as base64 (base64 -d >FILE; %s FILE)\n' "${finding}" "${build}/bin/fuzz_${target}"
  base64 "${finding}"
else
  tail -n 40 "${log}"
fi
exit 1
