#!/bin/sh
# A small run, exported and read with the real lerobot: reproduce/lerobot_reader.sh [DATA]
# DATA: a data set that is there already. It needs Python 3.12 or newer (PYTHON names it) and 6 GB:
# lerobot comes with PyTorch. It gets an environment of its own, .cache/venv-lerobot.
set -eu
cd "$(dirname "$0")/.."
venv=.cache/venv-lerobot
if [ ! -e $venv/.made ]; then
    "${PYTHON:-python3.12}" -m venv --clear $venv
    $venv/bin/pip install --quiet --disable-pip-version-check 'lerobot[dataset]==0.6.1'
    touch $venv/.made
fi
data=${1:-}
if [ -z "$data" ]; then
    run=$(mktemp -d)
    trap 'rm -rf "$run"' EXIT
    .venv/bin/pliant experiment --pegs circle square --reasoners rules none --trials 2 \
        --first-seed 5 --save all --out "$run/run"
    data=$run/data
    .venv/bin/pliant export "$run/run" --lerobot "$data" --cameras side wide
fi
HF_HUB_OFFLINE=1 $venv/bin/python reproduce/lerobot_reader.py "$data"
