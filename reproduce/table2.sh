#!/bin/sh
# Table II, 20 cells of 400 trials: reproduce/table2.sh [OUT] [options of pliant experiment]
set -eu
cd "$(dirname "$0")/.."
out=${1:-runs/table2}
[ $# -eq 0 ] || shift
exec .venv/bin/pliant experiment reproduce/table2.yaml --out "$out" "$@"
