#!/usr/bin/env bash
# Builds the wheels of pliant, of its benchmark's cases and of its own model into a folder, from which
# they install together: pip install --find-links FOLDER 'pliant[local]'
#
#     tools/build_wheels.sh FOLDER
set -euo pipefail
mkdir -p "$1"
folder=$(cd "$1" && pwd)
cd "$(dirname "$0")/.."
export UV_CACHE_DIR="${UV_CACHE_DIR:-$PWD/.cache/uv}"
rm -f "$folder"/pliant*.whl
for source in . packages/cases packages/vlm; do
  .tools/bin/uv build --quiet --wheel --out-dir "$folder" "$source"
done
