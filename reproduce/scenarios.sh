#!/bin/sh
# What the rules do where something is not as the task says: reproduce/scenarios.sh [FOLDER].
# 48 trials each and 138 on L9; three hours on one core, half of that on two. The same command goes on where it stopped.
# The rows go into runs/scenarios_*.json; RESULTS=reproduce/results makes the published ones anew.
set -eu
cd "$(dirname "$0")/.."
out=${1:-runs/scenarios}
results=${RESULTS:-runs}
for name in wrong_peg no_peg bar_across bar_beside dead_sensor lying_camera blocked_hole \
    narrow_peg frozen_pictures blind scaled_sensor soft_wrist rough_hole flush_plug; do
    .venv/bin/pliant experiment --level "$name" --trials 16 --first-seed 32001 --out "$out/$name"
done
for name in long_peg short_peg turned_peg; do
    .venv/bin/pliant experiment --level "$name" --trials 24 --first-seed 32001 --out "$out/$name"
done
mkdir -p "$results"
.venv/bin/python reproduce/ladder.py "$results/scenarios_rules.json" "$out"/*
# One trial in two, on L9; and what two controls, which look for no signs, do there.
.venv/bin/pliant experiment --level L9 --trials 34 --first-seed 35001 --out "$out-L9/rules"
.venv/bin/pliant experiment --level L9 --reasoners none retry --trials 6 --first-seed 36001 \
    --out "$out-L9/controls"
.venv/bin/python reproduce/ladder.py "$results/scenarios_l9.json" "$out-L9/rules"
.venv/bin/python reproduce/ladder.py "$results/scenarios_unaware.json" "$out-L9/controls"
