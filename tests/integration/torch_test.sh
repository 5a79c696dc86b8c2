#!/usr/bin/env bash
# The learner and the policy workers with a PyTorch from pip, where there is neither nvcc nor a CUDA toolkit: they build, pass
# their unit tests, train, and a run continues where the other libtorch stopped, in both directions.
#
#   torch_test.sh BUILD_FOLDER      with Debian's libtorch, everything built
#
#   COMRAD_PIP_TORCH        folder of that PyTorch, as -DCOMRAD_TORCH takes it (default: that of the tests' Python)
#   COMRAD_PIP_TORCH_BUILD  where it is built (default: BUILD_FOLDER/pip-torch, which stays)
set -euo pipefail
debian="$1"
home="$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/../.." && pwd)"
build="${COMRAD_PIP_TORCH_BUILD:-${debian}/pip-torch}"

fail() {
  echo "torch_test: $*" >&2
  exit 1
}

torch="${COMRAD_PIP_TORCH:-}"
if [[ -z "${torch}" ]]; then
  for python in "${COMRAD_TEST_PYTHON:-}" "${debian}/test-python/bin/python"; do
    [[ -x "${python}" ]] || continue
    torch="$("${python}" -c 'import importlib.util; print(importlib.util.find_spec("torch").submodule_search_locations[0])')" && break
  done
fi
if [[ ! -d "${torch}" ]]; then
  echo "torch_test.sh:1: Skipped"
  echo "no PyTorch from pip: ./comrad test installs one, or COMRAD_PIP_TORCH names its folder"
  exit 77
fi

# A host without CUDA's tools: nothing in PATH and, where mounts are permitted, nothing on the disk.
if [[ -z "${COMRAD_TORCH_TEST_HIDDEN:-}" ]]; then
  export COMRAD_TORCH_TEST_HIDDEN=1
  if unshare --mount true 2>/dev/null; then exec unshare --mount --propagation private "$0" "$@"; fi
  echo "mounts are not permitted: a toolkit stays on the disk, and is looked for in what was included"
else
  for toolkit in /usr/local/cuda-* /usr/lib/cuda /usr/lib/nvidia-cuda-toolkit /opt/cuda; do
    [[ ! -d "${toolkit}" || -L "${toolkit}" ]] || mount -t tmpfs none "${toolkit}" 2>/dev/null || true
  done
fi
unset CUDA_HOME CUDA_PATH CUDACXX
path=''
while IFS= read -r folder; do
  [[ ! -e "${folder}/nvcc" ]] || { mkdir -p "${build}" && folder="${build}/path-without-nvcc${folder}" &&
    rm -rf "${folder}" && mkdir -p "${folder}" &&
    find "${folder#"${build}/path-without-nvcc"}" -maxdepth 1 ! -type d ! -name nvcc -exec ln -s -t "${folder}" {} +; }
  path+="${path:+:}${folder}"
done < <(tr ':' '\n' <<<"${PATH}")
PATH="${path}"
! command -v nvcc >/dev/null || fail "nvcc is still there: $(command -v nvcc)"

echo "PyTorch: ${torch}; building in ${build}, source by source"
cmake -S "${home}" -B "${build}" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_UNITY_BUILD=OFF -DCOMRAD_TORCH="${torch}" \
  >"${build}.configure.log" 2>&1 || fail "cmake: $(tail -n 20 "${build}.configure.log")"
grep "PyTorch" "${build}.configure.log" || fail "cmake does not say which PyTorch it found"
targets=(tools tests/unit/policy_workers/all tests/unit/learner/all)
# load_policy_test imports it; built where nanobind and Python's headers are.
! grep -q '^python_package:' <<<"$(ninja -C "${build}" -t targets all)" || targets+=(python_package)
cmake --build "${build}" --target "${targets[@]}" >"${build}.build.log" 2>&1 ||
  fail "the build failed: $(grep -A 30 -m 1 FAILED "${build}.build.log")"
! grep -E -m 5 '^[^ ]+:[0-9]+:[0-9]+: warning: ' "${build}.build.log" || fail "the compiler warned"

# Every header and library is of that PyTorch and of NVIDIA's wheels beside it, none of Debian's libtorch or a toolkit.
deps="$(ninja -C "${build}" -t deps)"
if strange="$(grep -E '^ +/usr/(include/(torch|ATen|c10|caffe2)/|local/cuda|lib/cuda)|^ +/opt/cuda' <<<"${deps}")"; then
  fail "headers of another libtorch or of a toolkit are used: $(head -n 5 <<<"${strange}")"
fi
! grep -m 3 "torch/include/fmt/" <<<"${deps}" || fail "PyTorch's fmt is used beside that of spdlog"
for program in comrad-learner comrad-policy-worker; do
  libraries="$(env -i ldd "${build}/bin/${program}")"
  ! grep "not found" <<<"${libraries}" || fail "${program} misses libraries in an empty environment"
  grep -q "libtorch_cpu.so => $(readlink -f "${torch}")/" <<<"${libraries}" ||
    fail "${program} takes libtorch_cpu.so from elsewhere: $(grep libtorch_cpu <<<"${libraries}")"
  if compgen -G "${torch}/lib/libtorch_cuda.so" >/dev/null || compgen -G "${torch}/lib/python3*/site-packages/torch/lib/libtorch_cuda.so" >/dev/null; then
    readelf -d "${build}/bin/${program}" | grep -q 'NEEDED.*libtorch_cuda.so' || fail "${program} does not load libtorch_cuda.so"
  fi
done
! ldd "${build}/bin/comrad-sim-worker" | grep libtorch || fail "a simulator loads libtorch"

export COMRAD_HOME="${home}" OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
for part in policy_workers learner; do
  ctest --test-dir "${build}/tests/unit/${part}" -L unit --output-on-failure >"${build}.${part}.log" 2>&1 ||
    fail "unit tests of ${part}: $(grep -E 'Failed|\*\*\*|Error' "${build}.${part}.log" | head -n 20)"
  grep -E "tests passed" "${build}.${part}.log"
done

"${build}/bin/comrad" doctor --json >"${build}.doctor.json" || fail "doctor: $(<"${build}.doctor.json")"
grep -o '"libtorch","level":"OK","found":"[^"]*"' "${build}.doctor.json" || fail "doctor does not name libtorch: $(<"${build}.doctor.json")"

# A run goes from one libtorch to the other and back, with everything that a checkpoint holds.
scratch="$(mktemp -d)"
trap 'rm -rf "${scratch}"' EXIT
frames_of() { grep -o '"env_frames": *[0-9]*' "${scratch}/$1/status.json" | tr -dc 0-9; }
for algo in ippo qmix; do
  goal=0 done_frames=0
  for programs in "${build}" "${debian}" "${build}"; do
    goal=$((goal + 20000))
    "${programs}/bin/comrad" train --scenario coop_health_gathering --algo "${algo}" --seed 42 --num_workers 1 --num_envs_per_worker 4 \
      --rollout 16 --batch_size 256 --rnn_size 32 --device cpu --learning_starts_decisions 1000 --train_dir "${scratch}" --experiment "${algo}" \
      --train_for_env_frames "${goal}" >"${scratch}/train.log" 2>&1 || fail "${algo} with ${programs}: $(tail -n 20 "${scratch}/train.log")"
    frames="$(frames_of "${algo}")"
    ((frames >= goal && done_frames >= goal - 20000)) || fail "${algo} with ${programs} stopped at ${frames} of ${goal} env frames"
    done_frames="${frames}"
    for other in "${build}" "${debian}"; do
      "${other}/bin/comrad" eval --policy "${scratch}/${algo}" --episodes 2 --seed 7 --json \
        >"${scratch}/eval.json" 2>"${scratch}/eval.log" || fail "eval with ${other}: $(tail -n 5 "${scratch}/eval.log")"
      grep -q '"episodes": *2' "${scratch}/eval.json" || fail "eval with ${other} printed $(<"${scratch}/eval.json")"
    done
  done
  echo "${algo}: trained ${done_frames} env frames by turns"
done
