#!/usr/bin/env bash
# deploy/security without the authority's key, after an interruption, and with identities that are no longer good.
# Argument: the source folder.
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

cd "$folder/security"
end=$(date -u -d "$(openssl x509 -in client/certificate.pem -noout -enddate | cut -d= -f2)" +%F)
[[ $said == *"kept 17; the first one expires on $end" ]] || fail "not what is in the folder: $said"
openssl x509 -x509toreq -in client/certificate.pem -signkey client/key.pem -out "$folder/request.pem" 2>/dev/null
openssl x509 -req -in "$folder/request.pem" -CA authority.pem -CAkey authority.key -set_serial 1 -days -1 \
  -out client/certificate.pem 2>/dev/null
sed 's/head_pose/other_topic/' tracker/permissions.xml >"$folder/permissions.xml"
openssl smime -sign -text -in "$folder/permissions.xml" -out tracker/permissions.p7s -signer authority.pem \
  -inkey authority.key
said=$("$1/deploy/security" --days 2 .)
[[ $said == "made 2 identities"* ]] || fail "an expired identity or other permissions were kept: $said"
[[ $said == *"expires on $(date -u -d '2 days' +%F)" ]] || fail "wrong day: $said"
openssl x509 -in client/certificate.pem -noout -checkend 0 >/dev/null || fail "the identity is still expired"
grep -q head_pose tracker/permissions.p7s || fail "the permissions are still others"

# An authority of the user that may sign certificates, but no mail.
mkdir "$folder/own"
cd "$folder/own"
openssl req -x509 -new -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -subj /CN=own -days 3 \
  -addext keyUsage=critical,keyCertSign,cRLSign -keyout authority.key -out authority.pem 2>/dev/null
"$1/deploy/security" . >/dev/null
said=$("$1/deploy/security" .)
[[ $said == "made 0 identities"* ]] || fail "good identities of the user's authority were made again: $said"
