#!/usr/bin/env bash
# Builds the wheels, installs pliant's with the locked dependencies into an environment of its own, and
# uses it from there, then the others beside it: a file that only the checkout has must not go unnoticed.
set -euo pipefail
cd "$(dirname "$0")/.."
export UV_CACHE_DIR="${UV_CACHE_DIR:-$PWD/.cache/uv}"
uv=$PWD/.tools/bin/uv
source=$PWD/src/pliant

# Beside uv's cache, so that it links the packages instead of copying them.
mkdir -p .cache
folder=$(mktemp -d "$PWD/.cache/wheel.XXXXXX")
trap 'rm -rf "$folder"' EXIT

tools/build_wheels.sh "$folder/dist"
"$uv" export --quiet --frozen --no-dev --no-emit-project --output-file "$folder/locked.txt"
"$uv" venv --quiet "$folder/venv"
"$uv" pip install --quiet --python "$folder/venv/bin/python" \
  --requirement "$folder/locked.txt" "$folder"/dist/pliant-*.whl

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
apart = Path("experiment/bench/cases.zip")  # a distribution of its own
missing = {
    p for p in wanted if "__pycache__" not in p.parts and p != apart and not (installed / p).is_file()
}
assert not (installed / apart).exists(), "the cases are in the wheel"
assert not [*installed.parent.rglob("*.gguf")], "a model's weights are in the wheel"
assert not missing, f"not in the wheel: {sorted(map(str, missing))}"
assert {Path("py.typed"), Path("pegs/circle.yaml")} <= wanted
PYTHON
test "$(stat -c %s dist/pliant-*.whl)" -le 6000000 || { echo "The wheel is larger than 6 MB." >&2; exit 1; }
if venv/bin/pliant bench-reasoner coin --limit 1 2>said >/dev/null; then exit 1; fi
grep -q "packages/cases" said
"$uv" pip install --quiet --no-deps --python venv/bin/python dist/pliant_cases-*.whl
venv/bin/pliant bench-reasoner coin --limit 1 >/dev/null
if venv/bin/pliant run --reasoner vlm --out out 2>said; then exit 1; fi
grep -q "pliant\[local\]" said
test ! -e out
"$uv" pip install --quiet --no-deps --python venv/bin/python dist/pliant_vlm-*.whl
diff -r --exclude __pycache__ "${source%/src/pliant}/packages/vlm/pliant_vlm" venv/lib/python3*/site-packages/pliant_vlm
echo "The wheel installs and works, and so do the cases and the model beside it."
