#!/bin/sh
# Controls on the ladder: reproduce/ladder_controls.sh [FOLDER]. The first five of its seeds, three pegs:
# the paper's skills with the rules, and the guided skills with every other way to recover.
set -eu
cd "$(dirname "$0")/.."
out=${1:-runs/ladder_controls}
run() {  # LEVEL NAME OPTION...
    level=$1
    name=$2
    shift 2
    .venv/bin/pliant experiment --level "$level" --trials 5 --first-seed 20001 --out "$out/$name" "$@"
}
run L1 L1-none --reasoners none
run L1 L1-planar --skills planar
run L3 L3-planar --skills planar
run L4 L4-guided --reasoners none retry sweep messages
.venv/bin/python reproduce/ladder.py reproduce/results/ladder_controls.json "$out"/*
