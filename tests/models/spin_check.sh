#!/bin/sh
# Checks a Promela model exhaustively: spin_check.sh MODEL [-DNAME…]. Exit code: 0 holds, 1 violated, 77 no spin.
# Example: tests/models/spin_check.sh tests/models/channel.pml -DBROKEN
set -eu
command -v spin >/dev/null || { echo "SKIP: spin is not installed"; exit 77; }
model=$(realpath "$1")
shift
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
spin -a "$@" "$model"
cc -O2 -w -DSAFETY -DNOREDUCE -o pan pan.c
./pan -m100000 >report
grep -E 'errors:|states, stored|assertion violated|invalid end' report
grep -q 'errors: 0' report && ! grep -q 'search depth too small' report
