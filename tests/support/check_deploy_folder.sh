#!/usr/bin/env bash
# check_deploy_folder.sh SOURCE: tests deploy/run and deploy/headset in a tree with a blank in its name. They must start
# the tree's own program, and this program must find files relative to the caller's folder.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
tree="$folder/the tree"
mkdir -p "$tree/deploy" "$tree/build/release/bin" "$tree/config" "$folder/caller"
cp "$1/deploy/run" "$1/deploy/headset" "$tree/deploy"
cp -r "$1/config/rigs" "$tree/config"
printf '#!/bin/sh\n' | tee "$tree/deploy/build" > "$tree/deploy/certificate"
# This script replaces softhand. It checks that the rig can be read, and writes the summary.
cat > "$tree/build/release/bin/softhand" <<'end'
#!/bin/sh
[ "$1" = up ] && [ -f "$2" ] || exit 1
while [ "$1" != --json ]; do shift; done
echo done > "$2"
end
chmod +x "$tree/deploy/"* "$tree/build/release/bin/softhand"
cd "$folder/caller"
for script in run headset; do
  "../the tree/deploy/$script" --json "$script.json"
  [ -f "$script.json" ] || { echo "deploy/$script: the summary is not in the caller's folder" >&2; exit 1; }
done
