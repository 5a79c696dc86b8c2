# shellcheck shell=bash disable=SC2034 # it is sourced; its variables are for the script that sources it
# Roots of Debian releases, for what is built or tried away from this machine's packages. Sourced by bash scripts; needs root, namespaces,
# mmdebstrap and a mirror: the machine's own sources with the wanted release.

# Why no root can be made here, in words; nothing where it can.
why_no_root() {
  local program
  if ((EUID != 0)); then echo "only root may make another root folder" && return; fi
  for program in mmdebstrap unshare ip; do
    command -v "${program}" >/dev/null || { echo "${program} is not installed (deploy/packages_test.txt)" && return; }
  done
  unshare --mount --pid --net --fork true 2>/dev/null || echo "namespaces are not permitted here"
}

# make_root RELEASE FOLDER PACKAGE...: a minimal Debian with these packages; the folder's own, where it has a Debian already.
# Fails where the mirror does not have it, with mmdebstrap's last words in ${root_failure}.
make_root() {
  local release="$1" folder="$2" sources=/etc/apt/sources.list.d/debian.sources this list log
  shift 2
  if [[ ! -x "${folder}/usr/bin/apt-get" ]]; then
    [[ -f "${sources}" ]] || sources=/etc/apt/sources.list
    this="$(. /etc/os-release && echo "${VERSION_CODENAME}")"
    mkdir -p "${folder}"
    list="${folder%/}.$(basename "${sources}")" log="${folder%/}.log"
    sed "s/\\b${this}\\b/${release}/g" "${sources}" >"${list}"
    if ! mmdebstrap --quiet --variant=minbase ${1:+--include="$(IFS=, && echo "$*")"} "${release}" "${folder}" "${list}" >"${log}" 2>&1; then
      root_failure="$(tail -n 1 "${log}")"
      rm -f "${list}" "${log}"
      return 1
    fi
    rm -f "${list}" "${log}"
  fi
  cp /etc/resolv.conf /etc/hosts "${folder}/etc/"
}

# give_pip FOLDER: pip in that root is configured as here; ${pip_environment} and ${pip_folders} are for in_root.
pip_environment=() pip_folders=()
give_pip() {
  local folder
  [[ ! -f /etc/pip.conf ]] || cp /etc/pip.conf "$1/etc/"
  [[ ! -d /etc/xdg/pip ]] || { mkdir -p "$1/etc/xdg" && cp -r /etc/xdg/pip "$1/etc/xdg/"; }
  mapfile -t pip_environment < <(env | grep -iE '^(PIP_[A-Z_]+|[a-z]+_proxy)=' || true)
  if [[ -f "${PIP_CERT:-}" ]]; then
    cp "${PIP_CERT}" "$1/root/pip.crt"
    pip_environment+=(PIP_CERT=/root/pip.crt)
  fi
  pip_folders=()
  for folder in ${PIP_FIND_LINKS:-} $(pip config get global.extra-index-url 2>/dev/null | grep -oE 'file://[^ ]+' | sed 's,file://,,' || true); do
    pip_folders+=("${folder}")
  done
}

# copy_sources CHECKOUT FOLDER: the tracked files and those that git would add, as they are.
copy_sources() {
  rm -rf "$2"
  mkdir -p "$2"
  # stat leaves out what is deleted, but not yet for git.
  (cd "$1" && git -c safe.directory="$1" ls-files -z --cached --others --exclude-standard | { xargs -0 stat --printf '%n\0' 2>/dev/null || true; } |
    tar --null --files-from=- -c) | tar -C "$2" -x
}

# packages_of LIST: the names in a list of deploy/.
packages_of() { sed 's/[[:space:]#].*//; /^$/d' "${BASH_SOURCE[0]%/*}/../$1"; }

# ${ccache_bind} is for in_root: this machine's ccache, where there is one. It hits where compiler, packages and paths are the same.
ccache_bind=()
if command -v ccache >/dev/null; then ccache_bind=("$(ccache --get-config cache_dir):/root/.cache/ccache"); fi

# made_once CHECKOUT FOLDER COMMAND...: the command, which makes FOLDER's files of that checkout; nothing where they are of its files already.
made_once() {
  local checkout="$1" folder="$2" of
  shift 2
  mkdir -p "${folder}"
  of="$(git -c safe.directory="${checkout}" -C "${checkout}" rev-parse HEAD) $(git -c safe.directory="${checkout}" -C "${checkout}" diff HEAD | cksum)"
  (
    flock 9
    [[ -f "${folder}/.made_of" && "$(<"${folder}/.made_of")" == "${of}" ]] && exit 0
    rm -f "${folder}"/* "${folder}/.made_of"
    "$@" >"${folder}/build.log" 2>&1 && echo "${of}" >"${folder}/.made_of"
  ) 9>"${folder}/.lock"
}

# in_root NETWORK FOLDER [BIND...] -- COMMAND...: the command in that root, with processes, mounts and a separate empty environment.
# NETWORK is host or none; each BIND is a folder that appears there, read-only, or OUTSIDE:INSIDE, which may be written.
in_root() {
  local network="$1" options=(--mount --pid --fork --kill-child)
  shift
  [[ "${network}" == host ]] || options+=(--net)
  # shellcheck disable=SC2016
  unshare "${options[@]}" bash -c 'network="$1" root="$2"; shift 2
    [[ "${network}" == host ]] || ip link set lo up
    mount --bind "${root}" "${root}" && # tests change how mounts spread, which only a mount point can
      mount -t proc proc "${root}/proc" && mount --rbind /sys "${root}/sys" && mount --rbind /dev "${root}/dev" &&
      mount -t tmpfs -o size="${COMRAD_ROOT_SHM:-50%}" tmpfs "${root}/dev/shm" && mount -t tmpfs tmpfs "${root}/run" || exit
    while [[ "$1" != -- ]]; do
      if [[ "$1" == *:* ]]; then
        mkdir -p "${1%%:*}" "${root}/${1#*:}" && mount --bind "${1%%:*}" "${root}/${1#*:}" || exit
      elif [[ -d "$1" ]]; then
        mkdir -p "${root}/$1" && mount --bind -o ro "$1" "${root}/$1" || exit
      fi
      shift
    done
    exec chroot "${root}" env -i HOME=/root PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin LANG=C.UTF-8 "${@:2}"' \
    in_root "${network}" "$@"
}
