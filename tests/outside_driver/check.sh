#!/usr/bin/env bash
# check.sh SOURCE BUILD: installs the SDK of BUILD. Builds the driver of this folder and two samples against it, and
# runs the driver.
set -euo pipefail
source=$1 build=$2 work=$2/outside_driver
rm -rf "$work"
cmake --install "$build" --prefix "$work/sdk" >/dev/null
# The folder is copied, so that nothing in it can come from the source tree.
cp -r "$source/tests/outside_driver" "$work/driver"
mkdir "$work/driver/samples"
for kind in trackers haptics; do cp -r "$source/services/$kind/sample" "$work/driver/samples/$kind"; done
flags=
if grep -qw avx /proc/cpuinfo; then flags=-mavx; fi  # other flags than those of the library
cmake -S "$work/driver" -B "$work/build" -G Ninja -DCMAKE_BUILD_TYPE=Debug -DCMAKE_PREFIX_PATH="$work/sdk" \
  -DCMAKE_CXX_FLAGS="$flags" >/dev/null
cmake --build "$work/build"
if grep -rl "$source/" "$work/sdk" --include=*.cmake --include=*.hpp; then
  echo "the installed SDK names the source tree"
  exit 1
fi
program=$work/build/softhand-tracker-outside
scene=$work/scene.toml
printf '[tracker_outside]\nheight = 2.5\n[hand]\nmodel = "%s/config/hands/right_400.hand.json"\n' "$source" >"$scene"
export SOFTHAND_DOMAIN=100 # tests reserve the domains below
line=$(timeout 2 "$program" --config "$scene" || true)
[[ $line == "height 2.5" ]] || { echo "got '$line', expected 'height 2.5'"; exit 1; }
if "$program" --config "$scene" --set tracker_outside.hieght=1 2>"$work/errors"; then
  echo "a misspelt key was accepted"
  exit 1
fi
grep -q "did you mean 'height'" "$work/errors"
# `softhand` does not know the driver. It accepts the section and says so.
"$build/bin/softhand" check "$scene" >"$work/check" 2>&1
grep -q "\[tracker_outside\]: no driver of this build" "$work/check"
echo "the driver outside the repository runs"
