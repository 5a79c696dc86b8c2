#!/usr/bin/env bash
# Every C++ file reads as clang-format 14 (Debian 12's) writes it with .clang-format. To mend one: clang-format -i FILE.
# 77: another version or none is installed, nothing was compared.
set -euo pipefail
cd -- "$(dirname -- "${BASH_SOURCE[0]}")/../.."

formatter=''
for name in clang-format-14 clang-format; do
  if "${name}" --version 2>/dev/null | grep -q 'version 14\.'; then
    formatter="${name}"
    break
  fi
done
if [[ -z "${formatter}" ]]; then
  printf 'clang-format 14 is not installed (deploy/packages_test.txt; ./comrad test installs it)\n[  SKIPPED ] 1 test: formatting_test\n'
  exit 77
fi
find rollout_buffer policy_workers learner sim_workers scenarios doomgen deploy tests \
  \( -name '*.cc' -o -name '*.h' \) -print0 | xargs -0 -P2 -n 60 "${formatter}" --dry-run -Werror
