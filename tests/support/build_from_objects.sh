#!/usr/bin/env bash
# build_from_objects.sh NINJA FULL BUILD: builds the programs of the configured BUILD that differ from those of the
# finished build FULL. Objects, libraries and programs with the same commands are the same. It compiles the objects that
# BUILD compiles with other commands, and links what differs. Then each linked program must start. So a combination of
# options costs only a few links.
set -euo pipefail
ninja=$1 full=$2 build=$3
cd "$build"
mapfile -t programs < <("$ninja" -t targets all | sed -n 's/^\(bin\/softhand[^:]*\): .*/\1/p')
[ ${#programs[@]} -gt 5 ] || { echo "no programs in $build"; exit 1; }
"$ninja" -t commands "${programs[@]}" | sed "s#$build#$full#g" >commands
comm -13 <("$ninja" -C "$full" -t commands all | sort -u) <(sort -u commands) >own_commands
is_compilation() { [[ $1 =~ \ -c\ [^\ ]+$ ]]; }
compiled=0 linked=()
while IFS= read -r command; do is_compilation "$command" && compiled=$((compiled + 1)); done <own_commands
(cd "$full" && find idl common services tests \( -name '*.o' -o -name '*.a' \) -print0 |
  xargs -0 cp -lf --parents -t "$build")
mkdir -p bin
while IFS= read -r command; do
  # With an object of its own, BUILD may have libraries of its own: then it makes all libraries and programs.
  if is_compilation "$command" || ((compiled == 0)); then grep -qxF -- "$command" own_commands || continue; fi
  if is_compilation "$command"; then
    made=$(sed -E 's/.* -o ([^ ]+) -c .*/\1/' <<<"$command")
    mkdir -p "$(dirname "$made")"
  elif [[ $command == *"/ar qc "* ]]; then
    made=$(sed -E 's/.*\/ar qc ([^ ]+) .*/\1/' <<<"$command")
  elif [[ $command =~ \ -o\ (bin/[^\ ]+) ]]; then
    made=${BASH_REMATCH[1]}
    linked+=("$made")
  else
    continue
  fi
  rm -f "$made"  # it may be a hard link to a file of FULL
  bash -c "$command"
done <commands
for program in "${linked[@]}"; do "$program" --help >/dev/null; done
echo "${#linked[@]} of ${#programs[@]} programs linked, $compiled objects of their own"
