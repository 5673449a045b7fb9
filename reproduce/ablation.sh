#!/bin/sh
# What each mechanism of the guided skills is worth: reproduce/ablation.sh [FOLDER]. The first ten of
# the ladder's seeds, three pegs, one mechanism left out at a time, where it should matter. They are
# compared with the ladder's own trials, in runs/ladder or the folder LADDER.
# The table goes into runs/paired_times.md; RESULTS=reproduce/results makes the published one anew.
set -eu
cd "$(dirname "$0")/.."
out=${1:-runs/ablation}
results=${RESULTS:-runs}
without() {  # LEVEL MECHANISM...
    level=$1
    shift
    for mechanism in "$@"; do
        .venv/bin/pliant experiment --level "$level" --method "guided$mechanism" --trials 10 \
            --first-seed 50001 --out "$out/$level$mechanism"
    done
}
without L4 -swing -unload -light -hold -dither -recentre -ease
without L2 -recentre -ease
without L6+ -median
without L5 -calibration
mkdir -p "$results"
.venv/bin/python reproduce/paired_times.py "${LADDER:-runs/ladder}" "$out" >"$results/paired_times.md"
