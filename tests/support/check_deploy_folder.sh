#!/usr/bin/env bash
# check_deploy_folder.sh SOURCE: what deploy/run and deploy/headset start, in a tree with a blank in its name, is the tree's own and finds files from where the caller is.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
tree="$folder/the tree"
mkdir -p "$tree/deploy" "$tree/build/release/bin" "$tree/config" "$folder/caller"
cp "$1/deploy/run" "$1/deploy/headset" "$tree/deploy"
cp -r "$1/config/rigs" "$tree/config"
printf '#!/bin/sh\n' | tee "$tree/deploy/build" > "$tree/deploy/certificate"
# Instead of softhand: where it would read the rig, and where it would write the summary.
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
  [ -f "$script.json" ] || { echo "deploy/$script: the summary is not where the caller is" >&2; exit 1; }
done
