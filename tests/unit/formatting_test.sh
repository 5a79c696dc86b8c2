#!/usr/bin/env bash
# Every C++ file reads as clang-format 14 writes it with .clang-format. To fix one: build/test-python/bin/clang-format -i FILE.
#
#   formatting_test.sh VENV      VENV: the Python of the tests (or COMRAD_TEST_PYTHON), which clang-format is installed in
#
# 77: neither there nor on the PATH is one of that version; nothing was compared.
set -euo pipefail
venv="$(readlink -f -- "$1" || true)"
[[ -z "${COMRAD_TEST_PYTHON:-}" ]] || venv="$(dirname -- "$(dirname -- "${COMRAD_TEST_PYTHON}")")"
cd -- "$(dirname -- "${BASH_SOURCE[0]}")/../.."

formatter=''
for name in "${venv}/bin/clang-format" clang-format-14 clang-format; do
  if "${name}" --version 2>/dev/null | grep -q 'version 14\.'; then
    formatter="${name}"
    break
  fi
done
if [[ -z "${formatter}" ]]; then
  printf 'clang-format 14 is not installed (deploy/requirements_test.txt; ./comrad test installs it)\n[  SKIPPED ] 1 test: formatting_test\n'
  exit 77
fi
find rollout_buffer policy_workers learner sim_workers scenarios doomgen deploy tests \
  \( -name '*.cc' -o -name '*.h' \) -print0 | xargs -0 -P2 -n 60 "${formatter}" --dry-run -Werror
