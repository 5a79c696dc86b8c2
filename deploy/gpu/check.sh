#!/usr/bin/env bash
# Everything that needs a GPU to be known, on a machine that has one: builds with a CUDA PyTorch, runs the unit tests of the
# learner and the policy workers, compares CPU and GPU, measures all algorithms on two scenarios, and trains 100 M env frames.
# A part that fails is reported, and the others run. Writes OUT/gpu.json and OUT/gpu.md; logs of all parts stay in OUT.
#
#   deploy/gpu/check.sh [--wheels FOLDER] [--out FOLDER] [--device cuda] [--seconds 20] [--env_frames 1e8] [--preset paper]
#   deploy/gpu/check.sh --built --build FOLDER [--out FOLDER] ...
#   deploy/gpu/check.sh --dry --build FOLDER [--out FOLDER] [--quick]
#   deploy/gpu/check.sh --quick [--built --build FOLDER] ...
#
#   --quick             some eight minutes once it is built: the comparison, and the rates that settings of a GPU host hang on, one
#                       by one (policy workers as threads and as processes, large batches, the learner alone, no GPU)
#   --wheels FOLDER     no network: the PyTorch's wheels, as `pip download -d FOLDER torch==2.14.1 'cuda-toolkit[crt,cccl]'` brings
#   --built             nothing is compiled: FOLDER has the programs and the tests that know a device
#   --dry               on the CPU, with programs that FOLDER has already: the comparison runs, the commands of all benches are
#                       read, one small bench and a short training run
# Exit code 0: all parts did what they should; 1: one failed; 2: a wrong flag.
set -euo pipefail

home="$(cd -- "$(dirname -- "$(readlink -f -- "${BASH_SOURCE[0]}")")/../.." && pwd)"
build="${COMRAD_BUILD_DIR:-${home}/build}"
out='' wheels='' device=cuda seconds=20 env_frames=1e8 preset=paper dry=0 built=0 quick=0
algorithms=(ippo mappo happo idqn vdn qmix qplex_d qplex_q)
places=("stag_hunt_arena 2" "armory_siege 8")

say() { printf 'gpu check: %s\n' "$*" >&2; }
refuse() {
  say "error: $*"
  exit 2
}
while (($# > 0)); do
  case "$1" in
    --built) built=1 ;;
    --quick) quick=1 ;;
    --dry) dry=1 built=1 device=cpu seconds=1 env_frames=4000 preset=small ;;
    --wheels | --out | --build | --device | --seconds | --env_frames | --preset)
      (($# > 1)) || refuse "$1 needs a value"
      declare "${1#--}=$2"
      shift
      ;;
    -h | --help)
      sed -n '2,/^set /{/^set /d;s/^# \{0,1\}//;p}' "${BASH_SOURCE[0]}"
      exit 0
      ;;
    *) refuse "unknown flag $1; see --help" ;;
  esac
  shift
done
[[ -z "${wheels}" || -d "${wheels}" ]] || refuse "--wheels: there is no folder ${wheels}"
[[ "${build}" == /* ]] || build="${PWD}/${build}"
if ((built)) && [[ ! -x "${build}/bin/comrad" ]]; then refuse "--built and --dry need --build FOLDER, which has bin/comrad"; fi
command -v python3 >/dev/null || refuse "python3 is needed for the report"
out="${out:-${home}/train_dir/gpu_check}"
mkdir -p "${out}"
out="$(cd -- "${out}" && pwd)"
rm -rf "${out}/parts" && mkdir "${out}/parts"
export COMRAD_HOME="${home}"

# part NAME COMMAND...: runs it; its output is parts/NAME.log, what it prints on stdout parts/NAME.out. Writes how it ended and how
# long it took. While it runs, the GPU's load is noted each second.
failed=0
part() {
  local name="$1" begin end code=0 watcher=''
  shift
  say "${name}"
  if command -v nvidia-smi >/dev/null && ((!dry)); then
    nvidia-smi --query-gpu=utilization.gpu,memory.used --format=csv,noheader,nounits --loop=1 >"${out}/parts/${name}.gpu" 2>/dev/null &
    watcher=$!
  fi
  begin="$(date +%s.%N)"
  "$@" >"${out}/parts/${name}.out" 2>"${out}/parts/${name}.log" || code=$?
  end="$(date +%s.%N)"
  if [[ -n "${watcher}" ]]; then
    kill "${watcher}" 2>/dev/null || true
    wait "${watcher}" 2>/dev/null || true
  fi
  printf '%s %s %s\n' "${code}" "${begin}" "${end}" >"${out}/parts/${name}.end"
  if ((code != 0)); then
    failed=1
    say "${name} failed (exit code ${code}); see ${out}/parts/${name}.log: $(tail -n 1 "${out}/parts/${name}.log")"
    return 1
  fi
}
comrad() { "${build}/bin/comrad" "$@"; }
one_test() { ctest --test-dir "${build}" -R "^$1\$" --no-tests=error --output-on-failure; }
unit_tests() { ctest --test-dir "${build}/tests/unit/$1" -L unit --output-on-failure; }
write_report() { python3 "${home}/deploy/gpu/report.py" "${out}" "${dry}" "${device}" "${preset}"; }

build_all() {
  COMRAD_BUILD_DIR="${build}" COMRAD_TORCH="${wheels:-pip}" "${home}/comrad" version
  cmake --build "${build}" --target tests/unit/policy_workers/all tests/unit/learner/all
}
sees_a_gpu() {
  comrad doctor --json
}

if ((!built)); then
  part build build_all || {
    write_report
    exit 1
  }
fi
part doctor sees_a_gpu || true
if ((!dry)) && ! grep -q '"name":"cuda","level":"OK","found":"[^"]*--device auto' "${out}/parts/doctor.out"; then
  say "no GPU is seen: $(grep -o '"name":"cuda"[^}]*' "${out}/parts/doctor.out" || echo 'doctor does not describe CUDA')"
  write_report
  exit 1
fi
# Tests that know COMRAD_TEST_DEVICE use that device; the others show that this libtorch computes on the CPU as Debian's does.
export COMRAD_TEST_DEVICE="${device}"
GTEST_OUTPUT="json:${out}/parts/parity.json" part parity one_test device_parity_test || true
if ((!dry && !quick)); then
  for name in policy_test batcher_test batch_test collate_slabs_test; do part "${name}" one_test "${name}" || true; done
fi
if ((!built && !quick)); then
  part unit_policy_workers unit_tests policy_workers || true
  part unit_learner unit_tests learner || true
fi
unset COMRAD_TEST_DEVICE

# rate NAME WORDS...: a bench; in a dry run its settings are read.
rate() {
  local name="$1"
  shift
  if ((!dry)); then
    part "bench_${name}" comrad bench "$@" --seconds "${seconds}" --json || true
  elif [[ "$1" == train ]]; then
    part "read_${name}" comrad config "${@:2}" --json || true
  fi
}
if ((quick)); then
  game=(--scenario coop_health_gathering --algo ippo) # with the preset's own network
  threads=(--policy_processes=False --policy_workers)
  lscpu >"${out}/lscpu.txt" 2>/dev/null || true
  for count in 1 2 3; do
    rate "${count}_policy_threads" train "${game[@]}" --preset small --device "${device}" "${threads[@]}" "${count}"
  done
  rate policy_processes train "${game[@]}" --preset small --device "${device}"
  rate preset_gpu train "${game[@]}" --preset gpu --device "${device}"
  rate large_batches train "${game[@]}" --preset gpu --device "${device}" --num_envs_per_worker 32
  for name in small paper; do rate "learner_${name}" learner "${game[@]}" --preset "${name}" --device "${device}"; done
  for count in 4 6 16; do rate "cpu_${count}_simulators" train "${game[@]}" --preset small --device cpu --num_workers "${count}"; done
  write_report
  ((!failed))
  exit
fi

for place in "${places[@]}"; do
  read -r scenario agents <<<"${place}"
  for algo in "${algorithms[@]}"; do
    settings=(--scenario "${scenario}" --num_agents "${agents}" --algo "${algo}" --preset "${preset}" --device "${device}")
    if ((dry)); then
      part "read_${scenario}_${algo}" comrad config "${settings[@]}" --json || true
    else
      part "bench_${scenario}_${algo}" comrad bench train "${settings[@]}" --seconds "${seconds}" --json || true
    fi
  done
done
small=()
if ((dry)); then
  small=(--num_workers 1 --num_envs_per_worker 4 --rollout 16 --batch_size 256 --rnn_size 32)
  part "bench_stag_hunt_arena_mappo" comrad bench train --scenario stag_hunt_arena --num_agents 2 --algo mappo --device "${device}" \
    "${small[@]}" --seconds "${seconds}" --json || true
fi
rm -rf "${out}/runs"
part train_mappo comrad train --scenario stag_hunt_arena --num_agents 2 --algo mappo --preset "${preset}" --device "${device}" --seed 42 \
  "${small[@]}" --train_for_env_frames "${env_frames}" --train_dir "${out}/runs" --experiment mappo || true
write_report
((!failed))
