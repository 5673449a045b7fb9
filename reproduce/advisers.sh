#!/bin/sh
# Scripted good and bad advisers behind the guards: reproduce/advisers.sh [OUT] [options]
set -eu
cd "$(dirname "$0")/.."
out=${1:-runs/advisers}
[ $# -eq 0 ] || shift
# One of the advisers never answers, on purpose: that is status 3.
PYTHONPATH=tests .venv/bin/pliant experiment reproduce/advisers.yaml --trust --out "$out" "$@" || [ $? -eq 3 ]
