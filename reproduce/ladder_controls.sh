#!/bin/sh
# Controls on the ladder: reproduce/ladder_controls.sh [FOLDER]. The first of its seeds: the guided skills
# with every other way to recover, and the paper's skills with every way.
# The rows go into runs/ladder_controls.json; RESULTS=reproduce/results makes the published ones anew.
set -eu
cd "$(dirname "$0")/.."
out=${1:-runs/ladder_controls}
results=${RESULTS:-runs}
run() {  # LEVEL NAME OPTION...
    level=$1
    name=$2
    shift 2
    .venv/bin/pliant experiment --level "$level" --trials 7 --first-seed 50001 --out "$out/$name" "$@"
}
for level in L4 L6; do
    run $level $level-guided --reasoners none retry sweep messages
done
for level in L1 L3; do
    run $level $level-planar --method planar --reasoners none retry sweep messages rules
done
mkdir -p "$results"
.venv/bin/python reproduce/ladder.py "$results/ladder_controls.json" "$out"/*
