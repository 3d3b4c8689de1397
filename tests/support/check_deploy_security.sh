#!/usr/bin/env bash
# deploy/security without the authority's key, and after an interruption. Argument: the source folder.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
fail() { echo "$*" >&2; exit 1; }
"$1/deploy/security" "$folder/security" > /dev/null
mv "$folder/security/authority.key" "$folder/authority.key"
"$1/deploy/security" "$folder/security" > /dev/null || fail "nothing was to sign"
said=$("$1/deploy/security" "$folder/security" tracker 2>&1) && fail "a renewal without the authority's key"
[[ $said == *"authority.key is missing"* ]] || fail "no reason: $said"
[[ -s $folder/security/governance.p7s && -s $folder/security/tracker/certificate.pem ]] || fail "signed files are gone"
mv "$folder/authority.key" "$folder/security/authority.key"
cp "$folder/security/hand/key.pem" "$folder/security/world/key.pem"  # as after an interrupted renewal
said=$("$1/deploy/security" "$folder/security")
[[ $said == "made 1 identities"* ]] || fail "the key of another identity was kept: $said"
