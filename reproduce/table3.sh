#!/bin/sh
# Table III, from the failed formation to the first of its plan: it is counted in Table II's trials.
# reproduce/table3.sh [OUT of table2.sh]
set -eu
cd "$(dirname "$0")/.."
out=${1:-runs/table2}
[ -f "$out/trials.parquet" ] || reproduce/table2.sh "$out" >/dev/null
.venv/bin/pliant tables "$out" | sed -n '/^## Table III/,/^## /p' | sed '$d'
