"""Gather the rows of several finished runs: python reproduce/ladder.py OUT.json RUN...

Of levels, or of scenarios where the file's name begins with `scenarios`.
"""

import json
import sys
from pathlib import Path

from pliant.experiment import tables
from pliant.levels import shipped_levels


def main() -> None:
    out, *runs = (Path(name) for name in sys.argv[1:])
    table, name = (
        ("scenarios", "scenario") if out.name.startswith("scenarios") else ("ladder", "level")
    )
    rows = [row for run in runs for row in tables.build(run)[table]]
    order = list(shipped_levels())
    rows.sort(key=lambda row: order.index(row[name]))
    out.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    print(f"{out}: {len(rows)} rows")


if __name__ == "__main__":
    main()
