#!/usr/bin/env bash
# The image of a release where there is no Docker, as a file for `docker load` and `podman load`, which is an OCI archive as well:
#
#   deploy/docker/build.sh [RELEASE] [FOLDER]      bookworm (default) or trixie; where it is put (default: dist/RELEASE)
#
# buildah makes the Dockerfile's last stage of FOLDER's Debian package, which ../package/build.sh made (and makes where it is not there), over a
# Debian of ../package/root.sh. Needs what that needs, buildah and python3.
set -euo pipefail
home="$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/../.." && pwd)"
release="${1:-bookworm}"
out="$(realpath -m -- "${2:-dist/${release}}")"
scratch="$(mktemp -d)"
# shellcheck source=deploy/package/root.sh
source "${home}/deploy/package/root.sh"
fail() {
  echo "build.sh: $*" >&2
  exit 1
}
# Images and containers of this build alone.
buildah() { command buildah --root "${scratch}/storage" --runroot "${scratch}/run" --storage-driver vfs "$@"; }
trap 'buildah umount --all >/dev/null 2>&1 || true; rm -rf --one-file-system "${scratch}"' EXIT

command -v buildah >/dev/null || fail "buildah is not installed (deploy/packages_test.txt)"
why="$(why_no_root)"
[[ -z "${why}" ]] || fail "${why}"
compgen -G "${out}/comrad_*.deb" >/dev/null || "${home}/deploy/package/build.sh" "${release}" "${out}"
version="$(sed -nE 's/^project\(comrad VERSION ([0-9.]+).*/\1/p' "${home}/CMakeLists.txt")"

base="$(buildah from scratch)"
root="$(buildah mount "${base}")"
make_root "${release}" "${root}" ca-certificates || fail "no Debian could be made: ${root_failure}"
rm -f "${root}"/etc/{resolv.conf,hosts} # this machine's
buildah commit --quiet --rm "${base}" "docker.io/library/debian:${release}-slim" >/dev/null
package="$(buildah from scratch)"
buildah copy --quiet "${package}" "${out}/comrad_${version}_amd64.deb" /package/comrad.deb >/dev/null
buildah commit --quiet --rm "${package}" localhost/package >/dev/null
buildah tag "docker.io/library/debian:${release}-slim" "docker.io/library/debian:${release}"
buildah build --quiet --isolation chroot --pull-never --build-arg "DEBIAN=${release}" --build-arg PACKAGE=localhost/package --build-arg TORCH=debian \
  --ignorefile "${home}/deploy/docker/Dockerfile.dockerignore" --file "${home}/deploy/docker/Dockerfile" --tag "comrad:${version}" "${home}" >/dev/null
buildah push --quiet "comrad:${version}" "oci:${scratch}/image:comrad:${version}"
# What Docker reads instead of index.json, unless containerd keeps its images.
python3 - "${scratch}/image" "comrad:${version}" <<'PYTHON'
import json, pathlib, sys
folder = pathlib.Path(sys.argv[1])
blob = lambda one: "blobs/" + one["digest"].replace(":", "/")
manifest = json.loads((folder / blob(json.loads((folder / "index.json").read_text())["manifests"][0])).read_text())
of_docker = [{"Config": blob(manifest["config"]), "RepoTags": [sys.argv[2]], "Layers": [blob(one) for one in manifest["layers"]]}]
(folder / "manifest.json").write_text(json.dumps(of_docker))
PYTHON
image="${out}/comrad_${version}_${release}_image.tar"
tar -C "${scratch}/image" --owner=0 --group=0 -cf "${image}" .
echo "$(basename "${image}"): $(stat -c %s "${image}") bytes"
