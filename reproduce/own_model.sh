#!/usr/bin/env bash
# What the model that comes with pliant scores: on stored cases, with black and with other cases' pictures,
# and alone in trials. Needs the extra local; a quarter of an hour on two cores.
#
#     reproduce/own_model.sh OUT
set -euo pipefail
out=${1:?give a new folder}
mkdir "$out"
for pictures in own black others; do
  pliant bench-reasoner vlm --no-fallback --pictures $pictures --out "$out/$pictures.json"
done
pliant experiment "$(dirname "$0")/own_model.yaml" --trust --out "$out/trials"
