#!/bin/sh
# Every control on paired seeds: reproduce/controls.sh [OUT] [options of pliant experiment]
set -eu
cd "$(dirname "$0")/.."
out=${1:-runs/controls}
[ $# -eq 0 ] || shift
exec .venv/bin/pliant experiment reproduce/controls.yaml --out "$out" "$@"
