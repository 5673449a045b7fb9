#!/bin/sh
# The reference rows of the reasoners' benchmark: reproduce/bench_reasoner.sh [OUT.json] [options]
# The published scores, reproduce/results/bench_reasoner.json: RESULTS=reproduce/results, and no OUT.
# A model's own row: .venv/bin/pliant bench-reasoner vlm --model PROVIDER:NAME
set -eu
cd "$(dirname "$0")/.."
out=${1:-${RESULTS:-runs}/bench_reasoner.json}
[ $# -eq 0 ] || shift
exec .venv/bin/pliant bench-reasoner rules messages coin --out "$out" "$@"
