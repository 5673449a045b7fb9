#!/bin/sh
# Table II with a VLM: reproduce/table2_vlm.sh MODEL [OUT] [options of pliant experiment]
# MODEL is provider:name, such as openai:gpt-4o, whose key is read from the environment; or with
# --base-url the name that a server of your own knows. The price is estimated and asked for first.
# The setting is the paper's own (--preset paper): no rules stand behind the model, so the rows of
# Tables II and III are its own. Every conversation is kept in OUT/recordings.
set -eu
cd "$(dirname "$0")/.."
if [ $# -eq 0 ]; then
  echo "usage: reproduce/table2_vlm.sh MODEL [OUT] [options of pliant experiment]" >&2
  exit 2
fi
model=$1
out=${2:-runs/table2-vlm}
if [ $# -gt 1 ]; then shift 2; else shift; fi
case " $* " in
  *" --save "*|*" --save="*) ;;
  *) set -- --save failures "$@" ;;
esac
exec .venv/bin/pliant experiment reproduce/table2_vlm.yaml --model "$model" --out "$out" \
  --record "$out/recordings" "$@"
