#!/usr/bin/env bash
# The Python package's tests against an extension module that was compiled with AddressSanitizer and UBSan.
#
#   asan_test.sh PYTHON BUILD_FOLDER
#
# Compiles the engine anew (minutes). Leaks are not looked for: Python itself has some at its end. Ends with 77 where the module
# cannot be made here.
set -euo pipefail
python="$1" build="$2"
here="$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")" && pwd)"
home="$(cd -- "${here}/../../../.." && pwd)"

if ! "${python}" -c 'import nanobind, nanobind_backend, gymnasium, pettingzoo' 2>/dev/null; then
  echo "[  SKIPPED ] 1 test, Python package under ASan: ${python} lacks nanobind, nanobind-backend, gymnasium or pettingzoo; ./comrad test installs them"
  exit 77
fi
flags="-O1 -g1 -fno-omit-frame-pointer -fsanitize=address,undefined -fno-sanitize-recover=all"
mkdir -p "${build}"
cmake -S "${home}" -B "${build}" -G Ninja -DSKBUILD=ON -DSKBUILD_SCRIPTS_DIR=bin -DPython_EXECUTABLE="$(command -v "${python}")" -DCMAKE_BUILD_TYPE=Asan \
  -DCMAKE_CXX_FLAGS="${flags}" -DCMAKE_C_FLAGS="${flags}" -DCMAKE_SHARED_LINKER_FLAGS="-fsanitize=address,undefined" >"${build}/configure.log" 2>&1 ||
  { tail -n 20 "${build}/configure.log"; exit 1; }
cmake --build "${build}" -j "$(nproc)" --target python_package >"${build}/build.log" 2>&1 || { tail -n 30 "${build}/build.log"; exit 1; }

export COMRAD_HOME="${home}" PYTHONPATH="${build}/python" ASAN_OPTIONS=detect_leaks=0:abort_on_error=0
export UBSAN_OPTIONS=print_stacktrace=1 OMP_NUM_THREADS=1
LD_PRELOAD="$(g++ -print-file-name=libasan.so) $(g++ -print-file-name=libubsan.so)"
for name in misuse environments interfaces; do
  echo "${name}_test.py"
  LD_PRELOAD="${LD_PRELOAD}" "${python}" -B "${here}/${name}_test.py"
done
