#!/usr/bin/env bash
# What a release must have, point by point: the versions agree, the changelog has it, wheels, packages and images are made and tried.
#
#   deploy/package/release.sh [--quick] [FOLDER]      where all is put (default: dist); --quick looks at the files alone
#
# Goes through all points and ends with 1 where one is not met. Needs what ../wheel/build.sh, build.sh and
# ../docker/build.sh need; an hour.
# shellcheck disable=SC2317 # point() calls the functions
set -uo pipefail
home="$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/../.." && pwd)"
quick=''
[[ "${1:-}" != --quick ]] || { quick=1 && shift; }
out="$(realpath -m -- "${1:-dist}")"
cd "${home}" || exit 2
failed=0

point() { # WHAT WHAT_TO_DO COMMAND...
  local what="$1" todo="$2" said
  shift 2
  if said="$("$@" 2>&1)"; then
    echo "ok      ${what}"
  else
    echo "NOT MET ${what}: ${todo}"
    [[ -z "${said}" ]] || tail -n 3 <<<"${said}" | sed 's/^/          /'
    failed=1
  fi
}
version="$(sed -nE 's/^project\(comrad VERSION ([0-9.]+).*/\1/p' CMakeLists.txt)"
echo "COMRAD ${version}"

is_version() { [[ "${version}" =~ ^[0-9]+\.[0-9]+\.[0-9]+$ ]]; }
citation_agrees() { grep -qxF "version: ${version}" CITATION.cff; }
changelog_has_it() { grep -qE "^## \[${version//./\\.}\] - 20[0-9]{2}-[01][0-9]-[0-3][0-9]$" CHANGELOG.md; }
nothing_waits() { [[ "$(sed -n '/^## \[Unreleased\]/,/^## \[[0-9]/{/^[*#] /p}' CHANGELOG.md | grep -vc '^## \[')" == 0 ]]; }
is_committed() { [[ -z "$(git -c safe.directory="${home}" status --porcelain)" ]]; }
is_tagged() { [[ "$(git -c safe.directory="${home}" describe --tags --exact-match HEAD)" == "v${version}" ]]; }
has_pages() { ls LICENSE CITATION.cff scenarios/DATASHEET.md deploy/wheel/freedoom/LICENSE >/dev/null; }
scenarios_have_versions() {
  local without
  without="$(grep -LE '^version *= *[1-9]' scenarios/*/scenario.toml)"
  echo "${without}" && [[ -z "${without}" ]]
}

point "CMakeLists.txt has a version" "write project(comrad VERSION x.y.z" is_version
point "CITATION.cff has the same" "write version: ${version}" citation_agrees
point "CHANGELOG.md has it, with its date" "write ## [${version}] - DATE" changelog_has_it
point "nothing is left under Unreleased" "move it below ${version}'s heading" nothing_waits
point "licences, citation and datasheet are there" "restore them" has_pages
point "every scenario has a version" "write version = N" scenarios_have_versions
point "everything is committed" "commit or remove what git status shows" is_committed
point "the commit has the tag v${version}" "git tag v${version}" is_tagged
if [[ -z "${quick}" ]]; then
  for release in bookworm trixie; do
    point "wheels are made, and work on ${release} with Python and pip alone" "read its words" \
      tests/integration/wheel_test.sh "${release}" "${out}/wheels"
    point "package and image of ${release} are made, and train" "read its words" tests/integration/package_test.sh "${release}" "${out}"
  done
  point "the wheels' metadata can be published" "pip install twine, and read its words" python3 -m twine check --strict "${out}/wheels"/*.whl
fi
exit "${failed}"
