"""Paste the stored results into the documents that show them.

    python tools/paste_results.py            # after reproduce/*.sh and copying tables.json here
    python tools/paste_results.py --check    # exit 1 where a document differs

The results lie in reproduce/results/, where RESULTS=reproduce/results lets the scripts write:
`tables.json` of a run, or a Markdown table. A document names one between `<!-- NAME -->` and
`<!-- /NAME -->`; nobody types such a figure.
"""

import json
import re
import sys
from pathlib import Path
from typing import Any

from pliant.experiment import paper, tables_text
from pliant.experiment.bench import table as bench
from pliant.experiment.statistics import wilson
from pliant.table import Table

ROOT = Path(__file__).parent.parent
RESULTS = ROOT / "reproduce" / "results"
DOCUMENTS = (
    "README.md",
    "docs/assumptions.md",
    "docs/bench-reasoner.md",
    "docs/ladder.md",
    "docs/real-cell.md",
    "docs/results.md",
    "docs/scenarios.md",
)


def summary() -> str:
    """The README's rows: who decides, on what, and how often it came out right."""
    cells = {
        (cell["peg"], cell["condition"], cell["reasoner"]): cell["inserted"]
        for cell in _stored("table2")["cells"]
    }
    theirs = paper.table2("circle", "all", "rules")
    assert theirs is not None, "the paper has the circle's row"
    successes = round(theirs.inserted_percent * theirs.trials / 100)
    judged = next(iter(_stored("bench_smollm2")["reasoners"].values()))["all"]
    (all_at_once,) = _stored("ladder_front")  # L8 as the code is now, on seeds of its own
    scenarios = [row["rightly"] for row in _stored("scenarios_rules")]
    rightly = [sum(row[key] for row in scenarios) for key in ("successes", "n")]
    grid = "the paper's grid, round peg, everything random: inserted"
    rows = [
        ("paper: GPT-4o", grid, _share(successes, theirs.trials)),
        ("no recovery", grid, _told(cells["circle", "all", "none"])),
        ("rules", grid, _told(cells["circle", "all", "rules"])),
        ("rules less no recovery", "the same draws: difference [points]", _gain()),
        (
            "a model of 135 million parameters",
            "stored cases: judged right (balanced accuracy; a coin has 50)",
            _told(judged["balanced_accuracy"] | {"n": judged["n"]}),
        ),
        (
            "rules, guided skills",
            "[L8](docs/ladder.md), our hardest level: inserted",
            _told(all_at_once["inserted"]),
        ),
        (
            "rules, guided skills",
            "[scenarios](docs/scenarios.md), where the task itself is wrong: ended rightly",
            _share(*rightly),
        ),
    ]
    return Table(["who decides", "on what", "[%]"], rows).markdown()


def _gain() -> str:
    """What recovery is worth on the round peg with everything random, in the README's words."""
    (pair,) = (
        pair for pair in _pairs("table2") if (pair["peg"], pair["condition"]) == ("circle", "all")
    )
    return f"{_difference(pair)} of {pair['n']}"


def _pairs(run: str) -> list[Any]:
    """Rules less no recovery, in every cell of a run where both were tried on the same draws."""
    pairs = []
    for pair in _stored(run)["pairs"]:
        match pair["first"], pair["second"]:
            case "rules", "none":
                pairs.append(pair)
            case "none", "rules":
                pairs.append(_turned(pair))
    return pairs


def _turned(pair: dict[str, Any]) -> dict[str, Any]:
    """A pair with its second less its first, as earlier versions stored it."""
    return {
        **pair,
        "difference": 0.0 - pair["difference"],
        "low": -pair["high"],
        "high": -pair["low"],
        "only_first": pair["only_second"],
        "only_second": pair["only_first"],
    }


def _difference(pair: dict[str, Any]) -> str:
    return f"{pair['difference']:+.1f} [{pair['low']:+.1f}, {pair['high']:+.1f}]"


def recovery() -> str:
    """What recovery is worth, draw by draw, wherever no recovery was tried on the same draws."""
    head = ["run", "peg", "condition", "n", "none: inserted [%]", "rules: inserted [%]"]
    head += ["rules − none [points]", "only by rules", "only by none"]
    rows = []
    for run in ("table2", "controls"):
        document = _stored(run)
        cells = {(c["peg"], c["condition"], c["reasoner"]): c for c in document["cells"]}
        for pair in _pairs(run):
            if pair["peg"] is None:
                continue
            where = pair["peg"], pair["condition"]
            rates = [cells[*where, who]["inserted"]["percent"] for who in ("none", "rules")]
            rows.append(
                [
                    run,
                    *where,
                    pair["n"],
                    *(f"{rate:.1f}" for rate in rates),
                    _difference(pair),
                    pair["only_first"],
                    pair["only_second"],
                ]
            )
    return Table(head, rows).markdown()


def _share(successes: int, n: int) -> str:
    ends = wilson(successes, n)
    return _told(
        {"percent": 100 * successes / n, "low": 100 * ends.low, "high": 100 * ends.high, "n": n}
    )


def _told(rate: dict[str, Any]) -> str:
    return f"{rate['percent']:.1f} [{rate['low']:.1f}, {rate['high']:.1f}] of {rate['n']}"


def _stored(name: str) -> Any:
    return json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))


def block(name: str) -> str:
    """The Markdown that belongs between a name's marks."""
    if name == "summary":
        return summary()
    if name == "recovery":
        return recovery()
    markdown = RESULTS / f"{name.replace('-', '_')}.md"
    if markdown.is_file():
        return markdown.read_text(encoding="utf-8").strip()
    run, _, table = name.partition("-")
    if run == "bench":
        scores = _stored("bench_reasoner")
        small = _stored("bench_smollm2")
        scores["reasoners"] |= small["reasoners"]  # on the first cases of the same set
        if table in ("kind", "formation"):
            return bench.grouped(scores, table)
        shown = {"judging": bench.judging, "planning": bench.planning, "stopping": bench.stopping}
        return shown[table](scores)
    if run == "scenarios":
        return tables_text.scenarios(_stored(f"scenarios_{table}"))
    if run == "ladder":
        return tables_text.ladder(_stored(f"ladder_{table}"))
    if run == "table4":
        return tables_text.table4(_stored(f"table4_{table}")["placed"])
    document = _stored(f"{run}")
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
