#!/usr/bin/env bash
# A finding fails run.sh with 1 (not with the 77 of a skipped test) and prints its input.
#   finding_test.sh BUILD_FOLDER
set -euo pipefail

build="${1:?build folder}"
code=0
said="$("$(dirname -- "${BASH_SOURCE[0]}")/run.sh" finding 2 "${build}" 2>&1)" || code=$?
rm -f "${build}"/findings/finding-*
printf '%s\n' "${said}"
[[ "${code}" != 77 ]] || exit 77
[[ "${code}" == 1 ]] || { echo "a finding ended run.sh with ${code}, not 1"; exit 1; }
input="$(base64 "${build}/seeds/finding/wrong")"
grep -qxF "${input}" <<<"${said}" || { echo "the finding's input, ${input}, was not printed"; exit 1; }
grep -q 'deadly signal' <<<"${said}" || { echo "libFuzzer's report was not printed"; exit 1; }
