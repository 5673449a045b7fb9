#!/bin/sh
# Scripted good and bad advisers behind the guards: reproduce/advisers.sh [OUT] [options]
set -eu
cd "$(dirname "$0")/.."
out=${1:-runs/advisers}
[ $# -eq 0 ] || shift
exec .venv/bin/pliant experiment reproduce/advisers.yaml --out "$out" "$@"
