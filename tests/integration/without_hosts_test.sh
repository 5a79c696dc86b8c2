#!/bin/bash
# A build without hosts (-DCOMRAD_HOSTS=OFF) is configured: it has `comrad` and its bench of shared memory, and none of the
# programs and sources of the links. With `build` behind the folders the program is built too, and its messages are checked.
#
#   without_hosts_test.sh SOURCE_FOLDER CMAKE [build]
set -euo pipefail
source=$1 cmake=$2
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$cmake" -G Ninja -S "$source" -B "$folder" -DCOMRAD_HOSTS=OFF "-DCOMRAD_PARTS=rollout_buffer;deploy" >"$folder.log" 2>&1 ||
  { cat "$folder.log"; exit 1; }
rm -f "$folder.log"
plan=$(cat "$folder/build.ninja")
for wanted in comrad comrad-bench-transport; do
  grep -q "build bin/$wanted:" <<<"$plan" || { echo "$wanted is not built"; exit 1; }
done
if grep -E -q "comrad-trajectory-|comrad-frame-receiver|rollout_buffer/link/(frames|trajectories|session)/|deploy/hosts/[a-z_]*\.cc" <<<"$plan"; then
  echo "a build without hosts compiles sources of the links:"
  grep -E -o "(comrad-trajectory-|comrad-frame-receiver|rollout_buffer/link/(frames|trajectories|session)/|deploy/hosts/[a-z_]*\.cc)[a-z_.]*" <<<"$plan" | sort -u
  exit 1
fi
[ "${3:-}" = build ] || exit 0
"$cmake" --build "$folder" -j 2 --target comrad comrad-bench-transport
for words in "join 127.0.0.1/0123456789abcdef" "serve nothing"; do
  said=$("$folder/bin/comrad" $words 2>&1) && { echo "comrad $words did not fail"; exit 1; }
  [[ $(wc -l <<<"$said") = 1 && $said == *COMRAD_HOSTS=ON* ]] || { echo "comrad $words prints: $said"; exit 1; }
done
