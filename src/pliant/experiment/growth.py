"""What a result folder holds, and how it grows: more seeds, pegs, conditions or reasoners are added
to what is there, and nothing that is done is done again.

An experiment's `document` is of one call. The folder's own, in run.json, is of all calls: each cell
in it has its seeds, where they are not the whole document's.
"""

import json
from collections.abc import Mapping
from typing import Any

from pliant.errors import InputError
from pliant.experiment import decides

Document = Mapping[str, Any]
Names = tuple[str, str, str, str]
"""A cell's (level, peg, condition, reasoner)."""
_SEEDS, _OF_ONE_CALL = "seeds", ("cells", "trials", "first_seed", "fingerprint")
_WHOSE = {
    "reasoner_file": "the file of reasoner '{3}'",
    "method_file": "the method's file",
    "vlm": "the model's settings",
    "weights": "the model's weights",
    "task": "peg '{1}'",
    "condition": "condition '{2}'",
}


def names(cell: Document) -> Names:
    """A cell's names, as in the result's columns, from its document."""
    peg, condition = cell["task"]["peg"]["name"], cell["condition"]["name"]
    return cell["level"], peg, condition, cell["reasoner"]


def seeds(document: Document, cell: Document) -> range:
    """The seeds of a cell of a document."""
    if _SEEDS in cell:
        first, last = cell[_SEEDS]
        return range(int(first), int(last) + 1)
    first, trials = int(document.get("first_seed", 1)), int(document.get("trials", 0))
    return range(first, first + trials)


def planned(document: Document) -> int:
    """The number of trials that a folder has when it is finished."""
    return sum(len(seeds(document, cell)) for cell in document.get("cells", []))


def fingerprinted(document: Document) -> dict[str, Any]:
    """A document with its content hash, by which a folder is known; as plain JSON values."""
    plain = json.loads(json.dumps({k: v for k, v in document.items() if k != "fingerprint"}))
    return {**plain, "fingerprint": decides.digest(json.dumps(plain, sort_keys=True).encode())}


def grown(before: Document, now: Document, folder: object) -> Document:
    """The document of a folder in which both are: `before` itself where nothing is added.

    Raises:
        InputError: something that decides outcomes has changed since, so that the trials of both
            could not stand in one table; or there would be a gap between the seeds.
    """
    if changed := [*_changed(before, now)]:
        raise InputError(
            f"output folder '{folder}' holds results of another configuration"
            f" ({', '.join(changed)} differ): choose another folder, or remove it"
        )
    cells = {names(cell): dict(cell) for cell in before["cells"]}
    is_larger = False
    for cell in now["cells"]:
        known, asked = cells.get(names(cell)), seeds(now, cell)
        held = asked if known is None else seeds(before, known)
        if asked.start > held.stop or held.start > asked.stop:
            raise InputError(
                f"output folder '{folder}' holds the seeds {held.start} to {held.stop - 1}, and"
                f" {asked.start} to {asked.stop - 1} would leave a gap: choose another folder"
            )
        whole = range(min(held.start, asked.start), max(held.stop, asked.stop))
        if known is None or whole != held:
            is_larger = True
            cells[names(cell)] = {**(known or cell), _SEEDS: [whole.start, whole.stop - 1]}
    if not is_larger:
        return before
    for cell in cells.values():
        cell.setdefault(_SEEDS, [(own := seeds(before, cell)).start, own.stop - 1])
    longest = max(len(seeds(before, cell)) for cell in cells.values())
    versions = {**before["versions"], **now["versions"]}
    return fingerprinted(
        {**before, "trials": longest, "versions": versions, "cells": list(cells.values())}
    )


def _changed(before: Document, now: Document) -> list[str]:
    """What decides outcomes, and is another now, in words."""
    found = [
        name
        for name in sorted({*before, *now} - {*_OF_ONE_CALL, "versions"})
        if before.get(name) != now.get(name)
    ]
    versions = before.get("versions") or {}, now.get("versions") or {}
    common = {*versions[0]} & {*versions[1]}
    found += [
        f"{package} {versions[0][package]} and {versions[1][package]}"
        for package in sorted(common)
        if versions[0][package] != versions[1][package]
    ]
    known = {names(cell): cell for cell in before.get("cells", [])}
    for cell in now["cells"]:
        other = known.get(names(cell), cell)
        for part in sorted({*cell, *other} - {_SEEDS}):
            if cell.get(part) != other.get(part):
                found.append(_WHOSE.get(part, part).format(*names(cell)))
    return list(dict.fromkeys(found))
