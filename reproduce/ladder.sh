#!/bin/sh
# The ladder: reproduce/ladder.sh [FOLDER], on seeds that nothing was tuned on; about an hour and a half
# on two cores. The same command goes on where it stopped.
set -eu
cd "$(dirname "$0")/.."
out=${1:-runs/ladder}
climb() {  # LEVEL, TRIALS of each of its pegs, FIRST SEED
    .venv/bin/pliant experiment --level "$1" --trials "$2" --first-seed "$3" --out "$out/$1"
}
for level in L1 L2 L3 L4 L5 L5+ L6 L6+; do
    climb $level 67 50001
done
climb L7 25 50001
climb L8 67 50001
.venv/bin/python reproduce/ladder.py reproduce/results/ladder_rules.json "$out"/*
