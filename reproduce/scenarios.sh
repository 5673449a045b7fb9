#!/bin/sh
# What the rules do in the scenarios they were not written for: reproduce/scenarios.sh [FOLDER].
# Twelve trials each; half an hour on one core. The same command goes on where it stopped.
set -eu
cd "$(dirname "$0")/.."
out=${1:-runs/scenarios}
for name in wrong_peg no_peg blocked_hole bar_across bar_beside lying_camera dead_sensor; do
    .venv/bin/pliant experiment --level "$name" --trials 4 --first-seed 30001 --out "$out/$name"
done
.venv/bin/python reproduce/ladder.py reproduce/results/scenarios_rules.json "$out"/*
