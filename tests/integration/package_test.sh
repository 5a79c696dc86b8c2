#!/usr/bin/env bash
# The .deb in its own Debian: it installs with what it depends on, trains there without a network, with a /dev/shm of 64 MB and
# without being root, and its systemd unit resumes a run after a reboot and after a power cut.
#
#   package_test.sh BUILD_FOLDER
#
# Needs root, the packages of deploy/packages_test.txt and a mirror of Debian (the machine's own sources). Ends with 77 where one of
# these is missing. COMRAD_PACKAGE_ROOT names a folder to keep the new root in, and to take it from the next time.
set -euo pipefail
build="$1"
scratch="$(mktemp -d)"
root="${COMRAD_PACKAGE_ROOT:-${scratch}/root}"
container=''

descendants() {
  local one
  for one in $(pgrep -P "$1"); do echo "${one}" && descendants "${one}"; done
}
stop_container() { # SIGNAL: TERM shuts down; KILL is a power cut
  local inside=()
  [[ -n "${container}" ]] || return 0
  [[ "$1" != KILL ]] || mapfile -t inside < <(descendants "${container}") # they outlive systemd-nspawn
  kill "-$1" "${container}" "${inside[@]}" 2>/dev/null || true
  wait "${container}" 2>/dev/null || true
  container=''
}
clean_up() {
  stop_container KILL
  rm -rf --one-file-system "${scratch}"
}
trap clean_up EXIT

say() { echo "package_test: $*"; }
fail() {
  say "$*" >&2
  exit 1
}
skip() {
  echo "[  SKIPPED ] 1 test, the package: $*"
  exit 77
}
wait_until() { # SECONDS COMMAND...
  local seconds="$1" i
  shift
  for ((i = 0; i < 4 * seconds * ${COMRAD_TEST_PATIENCE:-1}; ++i)); do
    if "$@"; then return 0; fi
    sleep 0.25
  done
  return 1
}

((EUID == 0)) || skip "only root may make another root folder"
for program in mmdebstrap dpkg-shlibdeps unshare ip systemd-nspawn; do
  command -v "${program}" >/dev/null || skip "${program} is not installed; ./comrad test installs it"
done
unshare --mount --pid --net --fork true 2>/dev/null || skip "namespaces are not permitted here"

cpack --config "${build}/CPackConfig.cmake" -B "${scratch}/package" >"${scratch}/cpack.log" 2>&1 || fail "cpack: $(tail -n 20 "${scratch}/cpack.log")"
package="$(echo "${scratch}"/package/comrad_*.deb)"
depends="$(dpkg-deb --field "${package}" Depends)"
for wanted in libtorch libosmesa6 libddsc0 libopencv-core freedoom libopenblas0-openmp; do
  [[ "${depends}" == *"${wanted}"* ]] || fail "the package does not depend on ${wanted}: ${depends}"
done
if dpkg-deb --contents "${package}" | awk '{ print $6 }' | grep -vE '^\./(usr/|$)'; then fail "it writes outside of /usr"; fi
say "$(basename "${package}") of $(stat -c %s "${package}") bytes depends on ${depends}"

if [[ ! -x "${root}/usr/bin/apt-get" ]]; then
  sources=(/etc/apt/sources.list.d/debian.sources)
  [[ -f "${sources[0]}" ]] || sources=(/etc/apt/sources.list)
  mmdebstrap --quiet --variant=minbase --include=systemd,systemd-sysv "$(. /etc/os-release && echo "${VERSION_CODENAME}")" \
    "${root}" "${sources[@]}" >"${scratch}/root.log" 2>&1 || skip "no Debian could be made: $(tail -n 1 "${scratch}/root.log")"
fi
before="$(chroot "${root}" dpkg-query -W -f '${Package}\n' | wc -l)"
cp "${package}" "${root}/root/comrad.deb"
cp /etc/resolv.conf "${root}/etc/resolv.conf"
inside() { # in its own namespaces; NETWORK is "host" or "none"
  local network="$1"
  shift
  local options=(--mount --pid --fork --kill-child)
  [[ "${network}" == host ]] || options+=(--net)
  # shellcheck disable=SC2016
  unshare "${options[@]}" bash -c 'root="$1"; shift
    [[ "$1" == host ]] || ip link set lo up
    shift
    mount -t proc proc "${root}/proc" && mount --bind /dev "${root}/dev" && mount -t tmpfs -o size=64m tmpfs "${root}/dev/shm" &&
      exec chroot "$@"' inside "${root}" "${network}" "$@"
}
inside host "${root}" sh -c 'apt-get update -q && DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends /root/comrad.deb' \
  >"${scratch}/install.log" 2>&1 || fail "the package does not install: $(tail -n 20 "${scratch}/install.log")"
say "installed; $(($(chroot "${root}" dpkg-query -W -f '${Package}\n' | wc -l) - before)) packages came along"
grep -q '^comrad:' "${root}/etc/passwd" || fail "there is no account for the unit"

settings='scenario = "coop_health_gathering"
algo = "ippo"
seed = 42
num_workers = 1
num_envs_per_worker = 4
rollout = 16
batch_size = 256
micro_batch_size = 64
num_epochs = 1
rnn_type = "gru"
rnn_size = 32
device = "cpu"
save_every_sec = 2
train_for_env_frames = '
mkdir -p "${root}/etc/comrad"
rm -rf "${root}/var/lib/comrad"
install -d -o "$(stat -c %u "${root}/home")" "${root}/var/lib/comrad"
chroot "${root}" chown comrad: /var/lib/comrad
echo "${settings}20000" >"${root}/etc/comrad/short.toml"
inside none --userspec=comrad "${root}" env -i comrad train --config /etc/comrad/short.toml --train_dir /var/lib/comrad --experiment short \
  >"${scratch}/train.log" 2>&1 || fail "train: $(tail -n 20 "${scratch}/train.log")"
grep -q '"state": *"finished"' "${root}/var/lib/comrad/short/status.json" || fail "no finished run"
inside none --userspec=comrad "${root}" env -i comrad eval --policy /var/lib/comrad/short --episodes 2 --json >"${scratch}/eval.json" \
  2>"${scratch}/eval.log" || fail "eval: $(tail -n 20 "${scratch}/eval.log")"
say "trained and played as the user comrad, without a network, with a /dev/shm of 64 MB"

# The unit, under its own systemd. A finished run and one without a goal in sight are enabled; the former must end at once.
echo "${settings}1e9" >"${root}/etc/comrad/long.toml"
chroot "${root}" systemctl enable comrad@long comrad@short >/dev/null 2>&1
run="${root}/var/lib/comrad/long"
frames() { sed -nE 's/.*"env_frames": *([0-9]+).*/\1/p' "${run}/status.json" 2>/dev/null | head -n 1; }
gets_beyond() { [[ -n "$(frames)" ]] && (($(frames) > $1)); }
rm -rf "${root}/var/log/journal" # of a root that was kept
mkdir -p "${root}/var/log/journal"
journal() { journalctl --directory="${root}/var/log/journal" --no-pager --output=cat "_SYSTEMD_UNIT=comrad@$1.service" + "UNIT=comrad@$1.service" 2>/dev/null; }
journal_has() { journal "$1" | grep -q "$2"; }
resumed() { (($(journal long | grep -c 'Resuming the run in /var/lib/comrad/long') == $1)) && gets_beyond "$2"; }
boot() {
  systemd-nspawn --quiet --directory="${root}" --register=no --keep-unit --private-network --console=pipe --boot \
    </dev/null >"${scratch}/console.log" 2>&1 &
  container=$!
}

boot
wait_until 120 gets_beyond 20000 || fail "comrad@long does not train: $(journal long | tail -n 20) $(tail -n 3 "${scratch}/console.log")"
wait_until 60 journal_has short 'Deactivated successfully' || fail "comrad@short, which is finished, does not end: $(journal short | tail -n 20)"
stop_container TERM
grep -q '"state": *"paused"' "${run}/status.json" || fail "a shutdown does not pause the run: $(<"${run}/status.json")"
if journal_has long 'SIGKILL\|timed out'; then fail "the stop took too long: $(journal long | tail -n 20)"; fi
at_shutdown="$(frames)"
say "shut down after ${at_shutdown} env frames"

boot
wait_until 120 resumed 1 "${at_shutdown}" || fail "it does not continue after a reboot: $(journal long | tail -n 20)"
newest() { find "${run}/checkpoint" -name 'checkpoint_*.pt' | sed -E 's/.*_([0-9]+)\.pt/\1/' | sort -n | tail -n 1; }
saved_beyond() { (($(newest) > $1)); }
wait_until 120 saved_beyond "${at_shutdown}" || fail "it saves no checkpoint: $(journal long | tail -n 20)"
stop_container KILL
saved="$(newest)"
say "power cut after checkpoint ${saved}"

boot
wait_until 120 resumed 2 "${saved}" || fail "it does not continue after a power cut: $(journal long | tail -n 20)"
stop_container TERM
say "continued after both"
