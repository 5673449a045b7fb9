#!/usr/bin/env bash
# Tries the bounds that pyproject.toml states: installs pliant with the extras gym and vlm into an
# environment of its own, with every stated package at its lowest version or all at their highest,
# and runs tests that touch each of them: physics, pictures, records, files, tables, the command
# line, videos and data sets, environments, a conversation with a model.
#
#     tools/try_bounds.sh lowest|highest
#
# Left out are tests that hold for the locked versions alone, since another MuJoCo or OpenCV gives
# other digits: recordings, statistics of seeds. The extras ray, rerun and ur5e are large: the locked
# versions are tested by `make test-system`, and what bounds them from below stands in pyproject.toml.
set -euo pipefail
cd "$(dirname "$0")/.."
export UV_CACHE_DIR="${UV_CACHE_DIR:-$PWD/.cache/uv}"
uv=$PWD/.tools/bin/uv

case "${1:-}" in
lowest) resolution=(--resolution lowest-direct) ;;
highest) resolution=(--resolution highest --upgrade) ;;
*)
  echo "usage: tools/try_bounds.sh lowest|highest" >&2
  exit 2
  ;;
esac

venv=$PWD/.cache/venv-$1
rm -rf "$venv" # MuJoCo does not survive being changed in place
"$uv" venv --quiet "$venv"
"$uv" pip install --quiet --python "$venv/bin/python" "${resolution[@]}" \
  --editable '.[gym,vlm]' --group dev
"$uv" pip list --quiet --python "$venv/bin/python" |
  grep -E '^(av|gymnasium|mujoco|numpy|opencv-python-headless|pyarrow|pydantic|pydantic-ai-slim|pyyaml|rich|tyro) '
"$venv/bin/pytest" -n 2 \
  tests/test_sim_model.py tests/test_vision.py tests/test_trial.py tests/test_store.py \
  tests/test_files.py tests/test_task.py tests/test_experiment_rows.py tests/test_tables.py \
  tests/test_bench_reasoner_cli.py tests/test_export_lerobot.py tests/test_envs.py \
  tests/test_vlm_reasoner.py tests/test_vlm_server.py tests/test_decides.py \
  --deselect tests/test_envs.py::test_pliant_alone_does_not_import_gymnasium_nor_the_environments_mujoco
