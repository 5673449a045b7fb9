#!/bin/sh
# The ladder: reproduce/ladder.sh [FOLDER], on seeds that nothing was tuned on; about an hour and a half
# on two cores. The same command goes on where it stopped.
set -eu
cd "$(dirname "$0")/.."
out=${1:-runs/ladder}
climb() {  # LEVEL, TRIALS of each of its pegs, FIRST SEED
    .venv/bin/pliant experiment --level "$1" --trials "$2" --first-seed "$3" --out "$out/$1"
}
climb L1 67 20001
climb L2 67 20001
climb L3 67 20001
climb L4 67 20001
climb L5 34 20001
climb L5+ 10 40001
climb L6 67 40001
climb L6+ 67 40001
climb L7 25 40001
climb L8 10 40001
.venv/bin/python reproduce/ladder.py reproduce/results/ladder_rules.json "$out"/*
