#!/bin/sh
# Controls on the ladder: reproduce/ladder_controls.sh [FOLDER]. The first of its seeds: the guided skills
# with every other way to recover, and the paper's skills with every way.
set -eu
cd "$(dirname "$0")/.."
out=${1:-runs/ladder_controls}
run() {  # LEVEL NAME TRIALS OPTION...
    level=$1
    name=$2
    trials=$3
    shift 3
    .venv/bin/pliant experiment --level "$level" --trials "$trials" --first-seed 50001 --out "$out/$name" "$@"
}
for level in L4 L6 L6+; do
    run $level $level-guided 7 --reasoners none retry sweep messages
done
run L7 L7-guided 3 --reasoners none retry sweep messages
for level in L1 L3; do
    run $level $level-planar 7 --skills planar --reasoners none retry sweep messages rules
done
.venv/bin/python reproduce/ladder.py reproduce/results/ladder_controls.json "$out"/*
