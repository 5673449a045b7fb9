#!/bin/sh
# The ladder: reproduce/ladder.sh [FOLDER]. 201 trials a level (25 for each of L7's eight pegs) on
# seeds that nothing was tuned on; two hours on two cores. The same command goes on where it stopped.
set -eu
cd "$(dirname "$0")/.."
out=${1:-runs/ladder}
for level in L1 L2 L3 L4 L5 L5+ L6 L6+ L8; do
    .venv/bin/pliant experiment --level "$level" --trials 67 --first-seed 20001 --out "$out/$level"
done
.venv/bin/pliant experiment --level L7 --trials 25 --first-seed 20001 --out "$out/L7"
.venv/bin/python reproduce/ladder.py reproduce/results/ladder_rules.json "$out"/*
