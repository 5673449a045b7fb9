#!/bin/sh
# The reference rows of the reasoners' benchmark: reproduce/bench_reasoner.sh [OUT.json] [options]
# A model's own row: .venv/bin/pliant bench-reasoner vlm --model PROVIDER:NAME
set -eu
cd "$(dirname "$0")/.."
out=${1:-reproduce/results/bench_reasoner.json}
[ $# -eq 0 ] || shift
exec .venv/bin/pliant bench-reasoner rules messages coin --out "$out" "$@"
