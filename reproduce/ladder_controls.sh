#!/bin/sh
# Controls on the ladder: reproduce/ladder_controls.sh [FOLDER]. The first ten of its seeds, three
# pegs: the paper's skills with the rules, and the guided skills with every other way to recover.
set -eu
cd "$(dirname "$0")/.."
out=${1:-runs/ladder_controls}
for level in L1 L4 L6+; do
    .venv/bin/pliant experiment --level "$level" --skills planar --trials 10 --first-seed 20001 \
        --out "$out/$level-planar"
    .venv/bin/pliant experiment --level "$level" --reasoners none retry sweep messages \
        --trials 10 --first-seed 20001 --out "$out/$level-guided"
done
.venv/bin/python reproduce/ladder.py reproduce/results/ladder_controls.json "$out"/*
