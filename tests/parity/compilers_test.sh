#!/usr/bin/env bash
# compilers_test.sh BUILD: maps and the painter's pictures are the same to the byte with gcc at -O0, with gcc at -O3 and fused
# operations allowed, and with clang, as with the compiler and the options of BUILD: 20 maps and 77 views of each scenario, 77 of
# each of ViZDoom's games.
set -euo pipefail
build="$1"
source="$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/../.." && pwd)"
folder="$(mktemp -d)"
trap 'rm -rf -- "${folder}"' EXIT

games=()
if python="$(ls "${build}"/test-python/bin/python 2>/dev/null)" &&
  found="$("${python}" -c 'import os, vizdoom; print(os.path.join(os.path.dirname(vizdoom.__file__), "scenarios"))' 2>/dev/null)"; then
  games=("${found}")
fi
export COMRAD_HOME="${source}"
cmake --build "${build}" --target view_hashes >"${folder}/here.log" 2>&1 || {
  tail -30 "${folder}/here.log" >&2
  exit 1
}
"${build}/tests/view_hashes" "${games[@]}" >"${folder}/here.txt" 2>"${folder}/here.log" || {
  cat "${folder}/here.log" >&2
  exit 1
}
views="$(awk '$3 == "views" { sum += $2 } END { print sum }' "${folder}/here.txt")"
[[ "${views}" -ge 1000 ]] || {
  echo "compilers_test: ${views} views are hashed, 1000 expected" >&2
  cat "${folder}/here.txt" >&2
  exit 1
}

compared=0
compare() { # NAME C++-COMPILER FLAGS
  command -v "$2" >/dev/null || {
    echo "$1: $2 is not installed; left out"
    return 0
  }
  cmake -S "${source}" -B "${folder}/$1" -G Ninja -DCMAKE_CXX_COMPILER="$2" \
    -DCMAKE_BUILD_TYPE=None -DCMAKE_CXX_FLAGS="$3" -DCOMRAD_GL=OFF \
    -DCOMRAD_PARTS="rollout_buffer;doomgen;scenarios;sim_workers" >"${folder}/$1.log" 2>&1 &&
    nice cmake --build "${folder}/$1" --target view_hashes >>"${folder}/$1.log" 2>&1 || {
    tail -30 "${folder}/$1.log" >&2
    exit 1
  }
  "${folder}/$1/tests/view_hashes" "${games[@]}" >"${folder}/$1.txt" 2>>"${folder}/$1.log"
  diff "${folder}/here.txt" "${folder}/$1.txt" || {
    echo "compilers_test: $1 draws other pictures" >&2
    exit 1
  }
  compared=$((compared + 1))
  echo "$1: ${views} views, all equal"
}
compare gcc_O0 "${CXX_GCC:-g++}" "-O0"
if grep -qw avx2 /proc/cpuinfo && grep -qw fma /proc/cpuinfo; then
  compare gcc_O3_avx2 "${CXX_GCC:-g++}" "-O3 -mavx2 -mfma"
fi
clang="$(compgen -c clang++ | sort -V | tail -1)"
compare clang "${clang:-clang++}" "-O2"
[[ "${compared}" -gt 0 ]] || {
  echo "compilers_test: no other compiler to compare with"
  exit 77
}
