#!/usr/bin/env bash
# Builds the wheel, installs it with the locked dependencies into an environment of its own, and
# uses it from there: a file that only the checkout has must not go unnoticed.
set -euo pipefail
cd "$(dirname "$0")/.."
export UV_CACHE_DIR="${UV_CACHE_DIR:-$PWD/.cache/uv}"
uv=$PWD/.tools/bin/uv
source=$PWD/src/pliant

# Beside uv's cache, so that it links the packages instead of copying them.
mkdir -p .cache
folder=$(mktemp -d "$PWD/.cache/wheel.XXXXXX")
trap 'rm -rf "$folder"' EXIT

"$uv" build --quiet --wheel --out-dir "$folder" .
"$uv" export --quiet --frozen --no-dev --no-emit-project --output-file "$folder/locked.txt"
"$uv" venv --quiet "$folder/venv"
"$uv" pip install --quiet --python "$folder/venv/bin/python" \
  --requirement "$folder/locked.txt" "$folder"/pliant-*.whl

cd "$folder"
venv/bin/pliant --help >/dev/null
venv/bin/python - "$source" <<'PYTHON'
import sys
from pathlib import Path

import pliant
from pliant.task import load_task

installed, source = Path(pliant.__file__).parent, Path(sys.argv[1])
assert installed != source, "the checkout was imported"
assert load_task("circle").peg.name == "circle"
wanted = {p.relative_to(source) for p in source.rglob("*") if p.is_file()}
missing = {p for p in wanted if "__pycache__" not in p.parts and not (installed / p).is_file()}
assert not missing, f"not in the wheel: {sorted(map(str, missing))}"
assert {Path("py.typed"), Path("pegs/circle.yaml")} <= wanted
PYTHON
echo "The wheel installs and works."
