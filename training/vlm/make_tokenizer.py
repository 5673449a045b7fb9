"""Trains the tokenizer on recorded decisions.

python make_tokenizer.py decisions tokenizer.json [--size 4096]
"""

import argparse
import gzip
import json
from collections.abc import Iterator
from pathlib import Path

import tokenizer as words


def texts(folder: Path, most: int) -> Iterator[str]:
    for path in sorted(folder.glob("*.jsonl.gz"))[:most]:
        with gzip.open(path, "rt", encoding="utf-8") as file:
            for trial in map(json.loads, file):
                for decision in trial["decisions"]:
                    yield decision["system"]
                    yield from (part for part in decision["user"] if part != "<image>")
                    yield decision["reply"]
                    yield decision["plain"]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("decisions", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--size", type=int, default=4096)
    parser.add_argument("--files", type=int, default=10**9)
    given = parser.parse_args()
    trained = words.trained(texts(given.decisions, given.files), given.size)
    trained.save(str(given.out))
    print(trained.get_vocab_size(), "tokens")


if __name__ == "__main__":
    main()
