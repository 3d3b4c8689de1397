#!/usr/bin/env bash
# measure_first_start.sh [FOLDER]: measures deploy/run in a bare Debian 12, from its start to the first frame in a
# browser. debootstrap makes the system in FOLDER/base once. Each run uses a fresh copy of it, with an empty compiler
# cache. The tree is the committed HEAD. Needs root, debootstrap, chromium, and a finished build of this tree, because
# it uses the browser driver there. MIRROR sets another Debian mirror, CA_FILE the certificates of an npm mirror.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
folder=${1:-/tmp/softhand_first_start}
system="$folder/system"
mkdir -p "$folder"
mirror=${MIRROR:-http://deb.debian.org/debian}
[ -d "$folder/base/usr" ] || debootstrap --variant=minbase bookworm "$folder/base" "$mirror"

umount_all() {
  local mount
  for mount in proc dev; do
    if mountpoint -q "$system/$mount"; then umount "$system/$mount"; fi
  done
}
clean_up() {
  [ -z "${run:-}" ] || kill -- "-$run" 2>/dev/null || true
  umount_all
}
trap clean_up EXIT
umount_all
rm -rf "$system"
cp -a "$folder/base" "$system"
mount --bind /proc "$system/proc"
mount --bind /dev "$system/dev"
cp -L /etc/resolv.conf "$system/etc/resolv.conf"
mkdir -p "$system/softhand"
git -C "$root" archive HEAD | tar -x -C "$system/softhand"
environment=(HOME=/root LANG=C.UTF-8 SOFTHAND_DOMAIN=100
             PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin)
if [ -n "${CA_FILE:-}" ]; then
  cp -L "$CA_FILE" "$system/etc/first_start_ca.crt"
  environment+=(NODE_EXTRA_CA_CERTS=/etc/first_start_ca.crt)
fi

echo "load before: $(cut -d' ' -f1-3 /proc/loadavg), cores: $(nproc)"
set -m # a process group of its own, so that all of deploy/run can be ended
chroot "$system" env -i "${environment[@]}" /softhand/deploy/run --set viewer.port=8099 >"$folder/run.log" 2>&1 &
run=$!
set +m
SOFTHAND_BUILD=$root/build/release SOFTHAND_SOURCE=$root \
  node "$root/tests/viewer/first_frame.mjs" http://127.0.0.1:8099 3600
echo "load after: $(cut -d' ' -f1-3 /proc/loadavg)"
grep 'deploy/build:' "$folder/run.log" | tail -n 1
kill -INT -- "-$run" 2>/dev/null || true
wait "$run" || true
run=
