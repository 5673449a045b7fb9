#!/bin/sh
# What the rules do where something is not as the task says: reproduce/scenarios.sh [FOLDER].
# 48 trials each; two hours on one core. The same command goes on where it stopped.
set -eu
cd "$(dirname "$0")/.."
out=${1:-runs/scenarios}
for name in wrong_peg no_peg bar_across bar_beside dead_sensor lying_camera blocked_hole \
    narrow_peg frozen_pictures scaled_sensor soft_wrist rough_hole flush_plug; do
    .venv/bin/pliant experiment --level "$name" --trials 16 --first-seed 32001 --out "$out/$name"
done
for name in long_peg short_peg; do
    .venv/bin/pliant experiment --level "$name" --trials 24 --first-seed 32001 --out "$out/$name"
done
.venv/bin/python reproduce/ladder.py reproduce/results/scenarios_rules.json "$out"/*
