#!/usr/bin/env bash
# The .deb in its own Debian: it installs with what it depends on, trains there without a network, with a /dev/shm of 64 MB and
# without being root, and its systemd unit resumes a run after a reboot and after a power cut.
# The image made of it can be read as an OCI archive and as Docker's, and trains as its user.
#
#   package_test.sh RELEASE FOLDER      bookworm or trixie; FOLDER/RELEASE keeps both between the tests of one commit
#
# Needs what deploy/package/build.sh and deploy/docker/build.sh need, which make both. Ends with 77 where one of these is missing.
# COMRAD_PACKAGE_ROOT names a folder to keep the new root in, and to take it from the next time.
set -euo pipefail
release="$1" made="$2/$1"
home="$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/../.." && pwd)"
scratch="$(mktemp -d)"
root="${COMRAD_PACKAGE_ROOT:-${scratch}/root}"
container=''
# shellcheck source=deploy/package/root.sh
source "${home}/deploy/package/root.sh"

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
  images umount --all >/dev/null 2>&1 || true
  rm -rf --one-file-system "${scratch}"
}
images() { buildah --root "${scratch}/storage" --runroot "${scratch}/run" --storage-driver vfs "$@"; }
trap clean_up EXIT

say() { echo "package_test, ${release}: $*"; }
fail() {
  say "$*" >&2
  exit 1
}
skip() {
  echo "[  SKIPPED ] 1 test, the package on ${release}: $*"
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

why="$(why_no_root)"
[[ -z "${why}" ]] || skip "${why}"
for program in buildah systemd-nspawn; do
  command -v "${program}" >/dev/null || skip "${program} is not installed; ./comrad test installs it"
done

make_root "${release}" "${root}" systemd systemd-sysv || skip "no Debian could be made: ${root_failure}"
make_both() { "${home}/deploy/package/build.sh" "${release}" "${made}" && "${home}/deploy/docker/build.sh" "${release}" "${made}"; }
made_once "${home}" "${made}" make_both || fail "build.sh: $(tail -n 20 "${made}/build.log")"
grep -E ' bytes' "${made}/build.log"
package="$(echo "${made}"/comrad_*.deb)" image="$(echo "${made}"/comrad_*_image.tar)"
depends="$(dpkg-deb --field "${package}" Depends)"
for wanted in libtorch libosmesa6 libddsc0 libopencv-core freedoom libopenblas0-openmp; do
  [[ "${depends}" == *"${wanted}"* ]] || fail "the package does not depend on ${wanted}: ${depends}"
done
if dpkg-deb --contents "${package}" | awk '{ print $6 }' | grep -vE '^\./(usr/|$)'; then fail "it writes outside of /usr"; fi
say "it depends on ${depends}"

before="$(chroot "${root}" dpkg-query -W -f '${Package}\n' | wc -l)"
cp "${package}" "${root}/root/comrad.deb"
inside() { # NETWORK COMMAND...
  local network="$1"
  shift
  COMRAD_ROOT_SHM=64m in_root "${network}" "${root}" -- "$@"
}
inside host sh -c 'apt-get update -q && DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends /root/comrad.deb' \
  >"${scratch}/install.log" 2>&1 || fail "the package does not install: $(tail -n 20 "${scratch}/install.log")"
say "installed; $(($(chroot "${root}" dpkg-query -W -f '${Package}\n' | wc -l) - before)) packages came along; the root has $(du -sm --one-file-system "${root}" | cut -f 1) MB"
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
inside none runuser -u comrad -- comrad train --config /etc/comrad/short.toml --train_dir /var/lib/comrad --experiment short \
  >"${scratch}/train.log" 2>&1 || fail "train: $(tail -n 20 "${scratch}/train.log")"
grep -q '"state": *"finished"' "${root}/var/lib/comrad/short/status.json" || fail "no finished run"
inside none runuser -u comrad -- comrad eval --policy /var/lib/comrad/short --episodes 2 --json >"${scratch}/eval.json" \
  2>"${scratch}/eval.log" || fail "eval: $(tail -n 20 "${scratch}/eval.log")"
inside none runuser -u comrad -- comrad doctor >"${scratch}/doctor.log" 2>&1 || fail "doctor: $(<"${scratch}/doctor.log")"
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
    SYSTEMD_CGROUP_ENABLE_LEGACY_FORCE=1 </dev/null >"${scratch}/console.log" 2>&1 &
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

# The image, as the two kinds of archive that it is, and as `docker run` would start it. buildah has no network then, either.
for kind in oci-archive docker-archive; do
  images pull --quiet "${kind}:${image}" >"${scratch}/image" 2>"${scratch}/pull.log" || fail "it is no ${kind}: $(<"${scratch}/pull.log")"
  about="$(images inspect --type image --format '{{.OCIv1.Config.Entrypoint}} {{.OCIv1.Config.Cmd}} {{.OCIv1.Config.User}} {{.OCIv1.Config.WorkingDir}}' "$(<"${scratch}/image")")"
  [[ "${about}" == '[comrad] [doctor] 1000 /runs' ]] || fail "the ${kind} starts ${about}"
done
started="$(images from --pull-never "$(<"${scratch}/image")")"
in_image() {
  unshare --net bash -c 'ip link set lo up && exec "$@"' in_image buildah --root "${scratch}/storage" --runroot "${scratch}/run" --storage-driver vfs \
    run --isolation chroot "${started}" -- comrad "$@" >"${scratch}/image.log" 2>&1 </dev/null || fail "comrad $* in the image: $(tail -n 20 "${scratch}/image.log")"
}
in_image doctor
in_image train --scenario coop_health_gathering --algo ippo --num_workers 1 --num_envs_per_worker 4 --rnn_size 32 --device cpu \
  --experiment first --train_for_env_frames 20000
in_image eval --policy train_dir/first --episodes 2
say "the image trained and played as user 1000; unpacked it has $(du -sm "$(images mount "${started}")" | cut -f 1) MB"
