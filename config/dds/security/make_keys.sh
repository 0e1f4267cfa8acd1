#!/usr/bin/env bash
# Makes what DDS Security needs in DIR: a local certificate authority, an identity for each role, and the
# signed governance and permissions. What exists is kept, but documents are signed anew.
# Example: config/dds/security/make_keys.sh ~/hapticd-keys
set -euo pipefail

usage() {
  cat <<'TEXT'
Usage: make_keys.sh DIR [DAYS]
Makes in DIR, valid for DAYS (default 1825):
  ca.pem ca.key        the authority; whoever has ca.key can admit anybody: keep it off the clients
  governance.p7s       signed
  daemon/ edge/ device/ viewer/ operator/   each cert.pem, key.pem, permissions.p7s
A client needs ca.pem, governance.p7s and the folder of its own role, nothing else.
TEXT
}
case ${1:-} in
  -h|--help) usage; exit 0 ;;
  ''|-*) usage >&2; exit 2 ;;
esac
days=${2:-1825}
[[ $days =~ ^[1-9][0-9]*$ ]] || { echo "make_keys.sh: DAYS is a whole number above 0, not $days" >&2; exit 2; }
command -v openssl >/dev/null || { echo "make_keys.sh: needs openssl (apt-get install openssl)" >&2; exit 1; }

templates=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
umask 077
mkdir -p "$1"
cd "$1"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

quiet() {  # openssl talks on stderr: only when it fails
  "$@" 2>"$work/log" || { cat "$work/log" >&2; echo "make_keys.sh: failed: $*" >&2; exit 1; }
}
new_key() { quiet openssl ecparam -name prime256v1 -genkey -noout -out "$1"; }
sign() {  # DOCUMENT OUT
  quiet openssl smime -sign -text -in "$1" -out "$2" -signer ca.pem -inkey ca.key
}

if [ ! -e ca.key ]; then
  new_key ca.key
  quiet openssl req -x509 -new -key ca.key -out ca.pem -days "$days" -subj "/O=hapticd/CN=hapticd local CA"
fi
sign "$templates/governance.xml" governance.p7s

for role in daemon edge device viewer operator; do
  mkdir -p "$role"
  if [ ! -e "$role/key.pem" ]; then
    new_key "$role/key.pem"
    quiet openssl req -new -key "$role/key.pem" -out "$work/request.pem" -subj "/O=hapticd/CN=$role"
    quiet openssl x509 -req -in "$work/request.pem" -CA ca.pem -CAkey ca.key -CAcreateserial \
      -CAserial "$work/serial" -out "$role/cert.pem" -days "$days"
  fi
  subject=$(openssl x509 -in "$role/cert.pem" -noout -subject -nameopt RFC2253)
  # A day back, for clocks that disagree.
  sed -e "s|@SUBJECT@|${subject#subject=}|" \
    -e "s|@NOT_BEFORE@|$(date -u -d '-1 day' +%Y-%m-%dT%H:%M:%S)|" \
    -e "s|@NOT_AFTER@|$(date -u -d "+$days days" +%Y-%m-%dT%H:%M:%S)|" \
    "$templates/permissions_$role.xml" >"$work/permissions.xml"
  sign "$work/permissions.xml" "$role/permissions.p7s"
done
echo "make_keys.sh: keys for daemon, edge, device, viewer and operator in $PWD, valid for $days days"
