#!/bin/sh
# The ladder: reproduce/ladder.sh [FOLDER], on seeds that nothing was tuned on; about an hour and a half
# on two cores. The same command goes on where it stopped.
# The rows go into runs/ladder_rules.json; RESULTS=reproduce/results makes the published ones anew.
set -eu
cd "$(dirname "$0")/.."
out=${1:-runs/ladder}
results=${RESULTS:-runs}
climb() {  # LEVEL, TRIALS of each of its pegs, FIRST SEED
    .venv/bin/pliant experiment --level "$1" --trials "$2" --first-seed "$3" --out "$out/$1"
}
for level in L1 L2 L3 L4 L5 L5+ L6 L6+; do
    climb $level 67 50001
done
climb L7 25 50001
climb L8 67 50001
mkdir -p "$results"
.venv/bin/python reproduce/ladder.py "$results/ladder_rules.json" "$out"/*
