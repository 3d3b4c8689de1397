#!/usr/bin/env bash
# build_from_objects.sh NINJA FULL BUILD: builds all programs of the configured BUILD. It uses the objects of the
# finished build FULL if FULL compiled them with the same commands. It compiles the objects that BUILD compiles with
# other commands. Then each program must start. So a combination of options costs only its links, not its compilation.
set -euo pipefail
ninja=$1 full=$2 build=$3
cd "$build"
compilations() { grep -E ' -c [^ ]+$' | sed "s#$build#$full#g" | sort -u; }
mapfile -t programs < <("$ninja" -t targets all | sed -n 's/^\(bin\/softhand[^:]*\): .*/\1/p')
[ ${#programs[@]} -gt 5 ] || { echo "no programs in $build"; exit 1; }
"$ninja" -t commands "${programs[@]}" >commands
comm -13 <("$ninja" -C "$full" -t commands all | compilations) <(compilations <commands) >own_compilations
(cd "$full" && find idl common services tests -name '*.o' -print0 | xargs -0 cp -lf --parents -t "$build")
mkdir -p bin
while IFS= read -r command; do
  if [[ $command =~ \ -c\ [^\ ]+$ ]]; then
    command=${command//"$build"/"$full"}  # so that it finds the headers that FULL generated
    grep -qxF -- "$command" own_compilations || continue
    object=$(sed -E 's/.* -o ([^ ]+) -c .*/\1/' <<<"$command")
    mkdir -p "$(dirname "$object")"
    rm -f "$object"  # a hard link to the object of FULL
  elif [[ $command != *"/ar qc "* && $command != *" -o bin/"* ]]; then
    continue
  fi
  bash -c "$command"
done <commands
for program in "${programs[@]}"; do "$program" --help >/dev/null; done
echo "${#programs[@]} programs linked, $(wc -l <own_compilations) objects of their own"
