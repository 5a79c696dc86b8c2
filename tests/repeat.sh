#!/usr/bin/env bash
# repeat.sh N [LOAD] [arguments of ctest]: runs the suite N times beside LOAD busy processes (default: none) and prints a table of
# what failed. The table is in <build folder>/repeat/table.md after every run, each run's output beside it; a stop half way keeps
# both and leaves no process behind. Exit code: 0 where nothing failed, 1 where something did, 2 for a wrong argument.
set -euo pipefail

home="$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd)"
build="${COMRAD_BUILD_DIR:-${home}/build}"
[[ "${build}" == /* ]] || build="${PWD}/${build}"

usage() {
  echo "repeat.sh: $1; expected repeat.sh N [LOAD] [arguments of ctest], for example repeat.sh 10 4 -L unit" >&2
  exit 2
}
[[ $# -ge 1 ]] || usage "the number of runs is missing"
[[ "$1" =~ ^[1-9][0-9]{0,3}$ ]] || usage "N is '$1', not a number from 1 to 9999"
runs="$1" load=0
shift
if [[ $# -ge 1 && "$1" != -* ]]; then
  [[ "$1" =~ ^[0-9]{1,3}$ ]] || usage "LOAD is '$1', not a number from 0 to 999"
  load="$1"
  shift
fi

folder="${build}/repeat"
table="${folder}/table.md"
rm -rf -- "${folder}"
mkdir -p "${folder}"
"${home}/comrad" test -N >"${folder}/list.log" 2>&1 || { # builds what is missing, so that the first run is as the others
  cat "${folder}/list.log" >&2
  exit 1
}

jobs_of_run=()
tree_of() { # a process and all below it
  local child
  echo "$1"
  for child in $(pgrep -P "$1" || true); do tree_of "${child}"; done
}
# Tests put what they start into their own process groups, so the whole tree is halted, which ends its growth, and then killed.
stop_jobs() {
  local job tree before
  for job in "${jobs_of_run[@]}"; do
    tree="${job}" before=''
    while [[ "${tree}" != "${before}" ]]; do
      before="${tree}"
      # shellcheck disable=SC2086
      kill -STOP ${tree} 2>/dev/null || true
      tree="$(tree_of "${job}")"
    done
    # shellcheck disable=SC2086
    kill -KILL ${tree} 2>/dev/null || true
  done
  jobs_of_run=()
}
trap stop_jobs EXIT
trap 'exit 130' INT
trap 'exit 143' TERM HUP

for ((i = 0; i < load; ++i)); do
  bash -c 'while :; do :; done' &
  jobs_of_run+=($!)
  disown
done
printf '%s, %s cores, commit %s, beside %s busy processes, %s\n\n| run | seconds | tests | failed |\n|---|---|---|---|\n' \
  "$(sed -n 's/^model name[^:]*: //p' /proc/cpuinfo | head -n 1)" "$(nproc)" \
  "$(git -C "${home}" rev-parse --short HEAD 2>/dev/null || echo unknown)" "${load}" "$(date +%F)" | tee "${table}"

failures=0
for ((run = 1; run <= runs; ++run)); do
  log="${folder}/run_${run}.log" begin="${SECONDS}" code=0
  "${home}/comrad" test "$@" >"${log}" 2>&1 </dev/null &
  jobs_of_run+=($!)
  wait $! || code=$?
  unset 'jobs_of_run[-1]'
  failed="$(sed -n -E '/\((Skipped|Disabled)\)$/d; s/^[[:space:]]*[0-9]+ - ([^ ]+) \(.*/\1/p' "${log}" | sort -u | paste -sd ' ')"
  [[ -n "${failed}" || "${code}" == 0 ]] || failed="exit code ${code}: $(tail -n 1 "${log}")"
  [[ "${code}" == 0 ]] || failures=$((failures + 1))
  printf '| %s | %s | %s | %s |\n' "${run}" "$((SECONDS - begin))" \
    "$(sed -n -E 's/.* tests failed out of ([0-9]+).*/\1/p' "${log}" | tail -n 1)" "${failed:-none}" | tee -a "${table}"
done
printf '\n%s of %s runs failed.\n' "${failures}" "${runs}" | tee -a "${table}"
((failures == 0))
