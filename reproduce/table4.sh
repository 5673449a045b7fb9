#!/bin/sh
# Table IV, seven combinations of five trials: reproduce/table4.sh [CELL] [OUT] [options]
# CELL is emulator (the default: a simulated cell behind the UR5e's own software, with no robot), sim,
# or the file of a real cell, whose operator is told what to place and asked how each trial went.
# The other options are those of pliant experiment. The same command goes on where it was stopped.
set -eu
cd "$(dirname "$0")/.."
cell=${1:-emulator}
[ $# -eq 0 ] || shift
case $cell in
  emulator|sim) name=$cell ;;
  *) name=$(basename "$cell" .yaml) ;;
esac
out=${1:-runs/table4-$name}
[ $# -eq 0 ] || shift
bin=.venv/bin
if [ "$cell" != sim ]; then # the vendors' libraries are in the environment of the system tests
  make -s .cache/venv-system/.synced
  bin=.cache/venv-system/bin
fi
set -- "$bin/pliant" experiment reproduce/table4.yaml --out "$out" "$@"
if [ "$cell" = emulator ]; then
  exec "$bin/python" reproduce/with_emulator.py --host "${HOST:-127.0.0.1}" "$@" --cell CELL
fi
exec "$@" --cell "$cell"
