"""Paste the stored results into the documents that show them.

    python tools/paste_results.py            # after reproduce/*.sh and copying tables.json here
    python tools/paste_results.py --check    # exit 1 where a document differs

The results lie in reproduce/results/: `tables.json` of a run, or a Markdown table. A document names
one between `<!-- NAME -->` and `<!-- /NAME -->`; nobody types such a figure.
"""

import json
import re
import sys
from pathlib import Path

from pliant.experiment import paper, tables_text
from pliant.experiment.bench import table as bench

ROOT = Path(__file__).parent.parent
RESULTS = ROOT / "reproduce" / "results"
DOCUMENTS = (
    "README.md",
    "docs/assumptions.md",
    "docs/bench-reasoner.md",
    "docs/ladder.md",
    "docs/real-cell.md",
    "docs/scenarios.md",
)


def block(name: str) -> str:
    """The Markdown that belongs between a name's marks."""
    markdown = RESULTS / f"{name.replace('-', '_')}.md"
    if markdown.is_file():
        return markdown.read_text(encoding="utf-8").strip()
    run, _, table = name.partition("-")
    if run == "bench":
        scores = json.loads((RESULTS / "bench_reasoner.json").read_text(encoding="utf-8"))
        small = json.loads((RESULTS / "bench_smollm2.json").read_text(encoding="utf-8"))
        scores["reasoners"] |= small["reasoners"]  # on the first cases of the same set
        if table in ("kind", "formation"):
            return bench.grouped(scores, table)
        shown = {"judging": bench.judging, "planning": bench.planning, "stopping": bench.stopping}
        return shown[table](scores)
    if run == "scenarios":
        return tables_text.scenarios(
            json.loads((RESULTS / f"scenarios_{table}.json").read_text(encoding="utf-8"))
        )
    if run == "ladder":
        return tables_text.ladder(
            json.loads((RESULTS / f"ladder_{table}.json").read_text(encoding="utf-8"))
        )
    if run == "table4":
        return tables_text.table4(
            json.loads((RESULTS / f"table4_{table}.json").read_text(encoding="utf-8"))["placed"]
        )
    document = json.loads((RESULTS / f"{run}.json").read_text(encoding="utf-8"))
    if table == "transitions":
        return tables_text.table3(document["transitions"], paper.REASONER)
    if table == "own":
        return tables_text.own(document["cells"])
    if table == "pairs":
        return tables_text.pairs(document["pairs"])
    return tables_text.table2(document["cells"])


def pasted(text: str) -> str:
    """A document with every block replaced by today's results."""
    mark = re.compile(r"<!-- ([a-z0-9-]+) -->\n.*?<!-- /\1 -->", re.DOTALL)
    return mark.sub(lambda m: f"<!-- {m[1]} -->\n{block(m[1])}\n<!-- /{m[1]} -->", text)


def main() -> int:
    changed = []
    for name in DOCUMENTS:
        path = ROOT / name
        before = path.read_text(encoding="utf-8")
        after = pasted(before)
        if after != before:
            changed.append(name)
            if "--check" not in sys.argv:
                path.write_text(after, encoding="utf-8")
    print("\n".join(changed) or "nothing to paste")
    return int("--check" in sys.argv and bool(changed))


if __name__ == "__main__":
    sys.exit(main())
