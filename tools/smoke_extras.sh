#!/usr/bin/env bash
# Installs the built wheel with each extra alone, in its locked versions, into an empty environment
# on each Python from 3.11 to 3.13 that this machine has, and uses what the extra brings: an import
# that only another extra or a developer's tool brings must not go unnoticed. Then a user's file is
# checked, strictly, against the types in the installed wheel.
#
#     tools/smoke_extras.sh [VERSION ...]
set -euo pipefail
cd "$(dirname "$0")/.."
export UV_CACHE_DIR="${UV_CACHE_DIR:-$PWD/.cache/uv}" UV_PYTHON_DOWNLOADS=never
uv=$PWD/.tools/bin/uv checkout=$PWD

declare -A uses=(
  [none]='import pliant; assert pliant.run(peg="circle", condition="none", reasoner="none").inserted'
  [local]='import openai, xllamacpp, pliant_vlm, pliant.reasoners.vlm.models'
  [gym]='import gymnasium, pliant.envs; gymnasium.make("pliant/Recovery-v0").reset(seed=1)'
  [ray]='import ray, pliant.experiment.on_ray'
  [rerun]='import rerun, pliant.export.recording'
  [ur5e]='import rtde_control, pyrealsense2, pliant.ur5e.arm, pliant.ur5e.camera'
  [vlm]='import anthropic, google.genai, openai, pliant.reasoners.vlm.models'
)

# Beside uv's cache, so that it links the packages instead of copying them.
mkdir -p .cache
folder=$(mktemp -d "$PWD/.cache/extras.XXXXXX")
trap 'rm -rf "$folder"' EXIT
tools/build_wheels.sh "$folder"
wheel=$(echo "$folder"/pliant-*.whl)

python_of() { # of that version: on the path, else pyenv's newest
  local at
  for at in "$(command -v "python$1")" "${PYENV_ROOT:-$HOME/.pyenv}/versions/$1".*/bin/python; do
    if [ "$("$at" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)" = "$1" ]; then
      echo "$at"
      return
    fi
  done
  return 1
}

installed() { # VENV EXTRA PYTHON; status 3: something of the extra is built for another Python only
  local of=() wheels=("$wheel")
  [ "$2" = none ] || of=(--extra "$2")
  [ "$2" != local ] || wheels+=("$folder"/pliant_vlm-*.whl)
  "$uv" venv --quiet --no-project --python "$3" "$1"
  "$uv" export --quiet --frozen --no-dev --no-emit-local "${of[@]}" --output-file "$1/locked.txt" >/dev/null
  "$uv" pip install --quiet --only-binary :all: --python "$1/bin/python" \
    --requirement "$1/locked.txt" "${wheels[@]}" 2>"$folder/said" && return
  cat "$folder/said" >&2
  grep -q "no usable wheels\|no wheels with a matching\|has no wheel" "$folder/said" && return 3
  return 1
}

typed() { # VENV: a file that is right, and one with three mistakes
  cat >"$folder/right.py" <<'PYTHON'
import pliant

trial = pliant.run(peg="circle", condition="all", seed=1, method="planar", reasoner="rules")
reasons: list[str] = [execution.verdict.reason for execution in trial.executions]
inserted: bool | None = trial.inserted
reveal_type(trial)
PYTHON
  cat >"$folder/wrong.py" <<'PYTHON'
import pliant

trial = pliant.run(peg="circle", sede=1)
depth: str = trial.executions[0].outcome.peak_compression_m
trial.insertd
PYTHON
  local mypy=("$checkout/.venv/bin/mypy" --strict --no-incremental --config-file=
    --python-executable "$1/bin/python")
  (
    cd "$folder"
    "${mypy[@]}" right.py >said || { cat said; return 1; }
    grep -q 'Revealed type is "pliant.records.Trial"' said || { cat said; return 1; }
    if "${mypy[@]}" wrong.py >said; then return 1; fi
    [ "$(grep -c '^wrong.py:.*error:' said)" = 3 ] || { cat said; return 1; }
  )
}

absent=() tried=0
for version in "${@:-3.11}" $([ $# -gt 0 ] || echo 3.12 3.13); do
  if ! python=$(python_of "$version"); then
    absent+=("there is no Python $version on this machine")
    continue
  fi
  tried=$((tried + 1))
  for extra in none gym local ray rerun ur5e vlm; do
    venv=$folder/$version-$extra
    status=0
    installed "$venv" $extra "$python" || status=$?
    if [ $status = 3 ]; then
      absent+=("what the extra '$extra' needs is not built for Python $version")
      continue
    fi
    [ $status = 0 ]
    (cd "$folder" && "$venv/bin/pliant" --version >/dev/null && "$venv/bin/python" -c "${uses[$extra]}") ||
      { echo "Python $version, the extra '$extra' alone: it does not work." >&2; exit 1; }
    [ $extra = none ] && { typed "$venv" || { echo "Python $version: the wheel's types" >&2; exit 1; }; }
    echo "Python $version, extra $extra: works"
    rm -rf "$venv"
  done
done
for why in "${absent[@]}"; do
  echo "NOT TRIED: $why." >&2
done
[ $tried -gt 0 ]
