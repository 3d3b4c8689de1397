#!/usr/bin/env bash
# check_deploy_build.sh SOURCE: tests which packages deploy/build installs, what it builds, and its lines on progress
# and errors. Fake commands replace dpkg-query, apt-get, sudo and cmake.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
tree="$folder/the tree" calls="$folder/calls"
mkdir -p "$tree/deploy" "$folder/bin"
cp "$1"/deploy/{build,packages,packages-test} "$tree/deploy"
export PATH="$folder/bin:$PATH" CALLS="$calls"
fake() { cat >"$folder/bin/$1" && chmod +x "$folder/bin/$1"; }
die() { printf 'check_deploy_build: %s\n' "$*" >&2; cat "$folder/output" >&2; exit 1; }
expect() { grep -qF -- "$2" "$1" || die "expected '$2' in $(basename "$1")"; }
refuse() { ! grep -qF -- "$2" "$1" || die "unexpected '$2' in $(basename "$1")"; }
build() { : >"$calls"; "$tree/deploy/build" "$@" >"$folder/output" 2>&1; }

# All packages of deploy/packages are there, npm as a part of nodejs and ninja-build removed.
fake dpkg-query <<'end'
#!/bin/sh
grep -v '^#' "$(dirname "$0")/../the tree/deploy/packages" | grep -vx 'npm\|ninja-build' | sed 's/.*/installed &, ,/'
echo 'installed nodejs, npm (= 9.2.0),'
echo 'config-files ninja-build, ,'
end
fake sudo <<'end'
#!/bin/sh
[ "$1" = -n ] || exec "$@"
end
fake apt-get <<'end'
#!/bin/sh
echo "apt-get $*" >>"$CALLS"
echo '0 upgraded, 1 newly installed, 0 to remove'
end
fake cmake <<'end'
#!/bin/sh
echo "cmake $*" >>"$CALLS"
if [ "$1" = --preset ]; then
  mkdir -p build/release
  touch build/release/build.ninja
  echo "$*" | sed -n 's/.*-D\(SOFTHAND_TESTS\)=\(.*\)/\1:BOOL=\2/p' >build/release/CMakeCache.txt
elif [ -e "$CALLS.broken" ]; then
  echo '[1/2] Building a.cpp'
  echo 'a.cpp:1: error: expected something'
  exit 1
else
  echo '[1/2] Building a.cpp'
fi
end

build run || die "deploy/build run failed"
expect "$calls" 'install -y --no-install-recommends ninja-build'
for package in ' npm' ' gcc' ' valgrind' ' chromium'; do refuse "$calls" "$package"; done
expect "$calls" 'cmake --preset release -DSOFTHAND_TESTS=OFF'
expect "$calls" 'cmake --build --preset release --target softhand_run'
for text in packages configure compile 's in total'; do expect "$folder/output" "$text"; done
expect "$tree/build/deploy.log" '[1/2] Building a.cpp'

# The folder is configured now.
build run || die "the second deploy/build run failed"
refuse "$calls" 'cmake --preset'

# The rest, in the same folder.
build || die "deploy/build failed"
for package in ninja-build valgrind chromium clang-format; do expect "$calls" " $package"; done
expect "$calls" 'cmake --preset release -DSOFTHAND_TESTS=ON'
refuse "$calls" --target
expect "$tree/build/release/CMakeCache.txt" 'SOFTHAND_TESTS:BOOL=ON'
build run || die "deploy/build run after deploy/build failed"
refuse "$calls" 'cmake --preset'

touch "$calls.broken"
! build run || die "a failed compilation was not reported"
expect "$folder/output" 'a.cpp:1: error: expected something'
expect "$folder/output" 'deploy/build: compile failed'
! build rum || die "an unknown part was not refused"
expect "$folder/output" "unknown part 'rum'"

# Every package is listed once.
twice=$(grep -hv '^#' "$tree"/deploy/packages* | sort | uniq -d)
[ -z "$twice" ] || die "listed twice: $twice"
