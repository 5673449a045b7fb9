"""Plan an experiment from a cross product of names, or from a YAML file with the same fields and,
where the cross product does not do, a list of cells:

    trials: 30
    cells:
    - {peg: circle, condition: [none, friction, pose, all], reasoner: none}
    - {peg: [circle, square, rectangle], condition: [none, friction, pose, all], reasoner: rules}
    - {peg: circle, condition: {name: windy, hole_y_mm: [-10, 10]}, reasoner: rules}
    - {peg: circle, condition: all, reasoner: [vlm, {name: no picture, picture: false}]}
    vlm: {model: "openai:gpt-4o"}

`vlm` holds the settings of every VLM in the file; one with a name of its own changes some. Files
that it names, pegs, reasoners and goals, are looked for from its own folder.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, TypeVar

from pliant import files
from pliant.conditions import CONDITIONS, Condition, check_range, condition
from pliant.errors import InputError, unknown, within
from pliant.experiment import oracle
from pliant.experiment.cells import WHOLE, Experiment
from pliant.experiment.one import Spec, whole
from pliant.experiment.trust import Agree, Named, refuse
from pliant.levels import FIELDS, load_level
from pliant.methods.named import method
from pliant.own import located_own, own_file
from pliant.paths import located
from pliant.reasoners import REASONERS, VLM, reasoner
from pliant.reasoners.vlm import settings as vlm_settings
from pliant.reasoners.vlm.settings import LOCAL, SHIPPED, Settings, located_model
from pliant.task import load_task, located_peg

T = TypeVar("T")

_BLOCK = {"pegs": "peg", "conditions": "condition", "reasoners": "reasoner"}
_FIELDS = (*_BLOCK, "level", "method", "cells", "trials", "first_seed", "goals", "vlm")
_CELL_FIELDS = (*_BLOCK.values(), "level", "method")


def load(
    path: Path,
    overrides: Mapping[str, Any] | None = None,
    *,
    agree: Agree = refuse,
    unnamed: str | None = LOCAL,
) -> Experiment:
    """Read an experiment file. `overrides` replace its fields of the same name; pegs, conditions
    and reasoners replace those of every listed cell too. Where the file itself names code or a
    model, `agree` is told before any of that code is run, and raises what it does not agree to; by
    default all of it. `unnamed` is the model where none is named; None: replies are recorded.

    Raises:
        InputError: the file cannot be read, a field, a name or a value in it is not valid, or what
            it names was not agreed to.
    """
    document = files.read_yaml(located(path), "experiment file", f"fields are {', '.join(_FIELDS)}")
    with document.at(()):
        return _planned(document.fields(), overrides, located(path).parent, agree, unnamed)


def from_fields(
    fields: Mapping[str, Any],
    overrides: Mapping[str, Any] | None = None,
    folder: Path | None = None,
    *,
    unnamed: str | None = LOCAL,
) -> Experiment:
    """Build an experiment from the fields of an experiment file. Relative paths in `fields` count
    from `folder`, or without it from the current folder, as those in `overrides` do.

    Cells are the cross product of `pegs`, `conditions` and `reasoners`, then those under `cells`;
    a cell that occurs twice counts once. A condition is a name or a mapping with a name and ranges;
    a reasoner is a name, or a mapping with a name and settings of the VLM. Code that it names is
    run: whoever calls this has chosen it. `unnamed` is the model where none is named; None: replies
    are recorded.

    Raises:
        InputError: a field, a name or a value is not valid.
    """
    return _planned(fields, overrides, folder, lambda named: None, unnamed)


def _planned(
    fields: Mapping[str, Any],
    overrides: Mapping[str, Any] | None,
    folder: Path | None,
    agree: Agree,
    unnamed: str | None,
) -> Experiment:
    given = dict(fields)
    replaced = {k: v for k, v in (overrides or {}).items() if v is not None}
    for name in (*given, *replaced):
        if name not in _FIELDS:
            with within(name):
                raise unknown("field", name, _FIELDS)
    given, replaced = _located(given, folder), _located(replaced, None)
    blocks = _listed_cells(given)
    if any(name in given for name in _BLOCK) or not blocks:
        every = {_BLOCK[k]: _Given(v, (k,)) for k, v in given.items() if k in _BLOCK}
        blocks.insert(0, ((), every))
    for _, block in blocks:
        block.setdefault("level", _Given(given.get("level", "L0"), ("level",)))
        block.update({_BLOCK[k]: _Given(v) for k, v in replaced.items() if k in _BLOCK})
        block.setdefault("method", _Given(given.get("method"), ("method",)))
        block.update({k: _Given(v) for k, v in replaced.items() if k in ("level", "method")})
    asked = {k: _Given(v, ("vlm", k)) for k, v in _settings(given).items()}
    asked |= {k: _Given(v) for k, v in _settings(replaced).items()}
    if unnamed != LOCAL:
        asked.setdefault("model", _Given(unnamed))
    cells: list[Spec] = []
    for place, block in blocks:
        cells += [cell for cell in _cells(place, block, asked) if cell not in cells]
    minds = [mind for _, block in blocks for mind in block["reasoner"].each()]
    ways = [block["method"] for _, block in blocks]
    agree(_named(minds, ways, asked))
    for mind in minds:
        mind.read(_see_that_it_can_be_made)
    for way in ways:
        way.read(lambda name: name is None or method(name))
    options = {**given, **replaced}
    goals = options.get("goals")
    if goals is not None and not isinstance(goals, str):
        with within("goals"):
            raise InputError(f"goals is {goals!r}: it must be the path of a goals file")
    for name in ("trials", "first_seed"):
        if name in given and name not in replaced:
            with within(name):
                whole(name, given[name], *WHOLE[name])
    return Experiment(
        cells=tuple(cells),
        trials=options.get("trials", 30),
        first_seed=options.get("first_seed", 1),
        goals=goals,
    )


@dataclass(frozen=True)
class _Given:
    """A value of an experiment's field, and where it stands in the experiment file; () where it was
    given otherwise."""

    value: Any
    place: files.Place = ()

    def each(self) -> "list[_Given]":
        """Each of the values, where it may be one or a list of them."""
        if not isinstance(self.value, list | tuple):
            return [self]
        places = [(*self.place, i) if self.place else () for i in range(len(self.value))]
        return [_Given(v, place) for v, place in zip(self.value, places, strict=True)]

    def read(self, reader: Callable[[Any], T]) -> T:
        """Read the value with a function. What that refuses is refused with the value's place."""
        with within(*self.place):
            return reader(self.value)


def _located(fields: Mapping[str, Any], folder: Path | None) -> dict[str, Any]:
    """The fields of an experiment with every path in them absolute. What is no name is left, to be
    refused."""
    makers = {"peg": located_peg, "reasoner": located_own, "method": located_own}
    makers |= {many: makers[single] for many, single in _BLOCK.items() if single in makers}

    def place(name: str, value: Any) -> Any:
        if isinstance(value, list | tuple):
            return [place(name, entry) for entry in value]
        if isinstance(value, dict) and "model" in value:  # a reasoner's own
            return {**value, "model": located_model(value["model"], folder)}
        return makers[name](value, folder) if isinstance(value, str) else value

    result = {k: place(k, v) if k in makers else v for k, v in fields.items()}
    if isinstance(asked := fields.get("vlm"), dict) and "model" in asked:
        result["vlm"] = {**asked, "model": located_model(asked["model"], folder)}
    if isinstance(cells := fields.get("cells"), list):
        result["cells"] = [
            _located(block, folder) if isinstance(block, dict) else block for block in cells
        ]
    if isinstance(goals := fields.get("goals"), str):
        result["goals"] = str(located(goals, folder))
    return result


def _listed_cells(given: Mapping[str, Any]) -> list[tuple[files.Place, dict[str, _Given]]]:
    """The cells listed in an experiment file, each with where it stands."""
    listed = given.get("cells", [])
    if not isinstance(listed, list) or not all(isinstance(b, dict) for b in listed):
        with within("cells"):
            raise InputError(f"cells must be a list, each with {', '.join(_CELL_FIELDS)}")
    result: list[tuple[files.Place, dict[str, _Given]]] = []
    for i, block in enumerate(listed):
        for name in block:
            if name not in _CELL_FIELDS:
                with within("cells", i, name):
                    raise unknown("field of a cell", name, _CELL_FIELDS)
        fields = {k: _Given(v, ("cells", i, k)) for k, v in block.items()}
        result.append((("cells", i), fields))
    return result


def _settings(fields: Mapping[str, Any]) -> dict[str, Any]:
    found = fields.get("vlm") or {}
    if not isinstance(found, dict):
        with within("vlm"):
            raise InputError(
                f"vlm is {found!r}: it must be settings, such as {{model: openai:gpt-4o}}"
            )
    return found


def _cells(
    place: files.Place, block: Mapping[str, _Given], asked: Mapping[str, _Given]
) -> Iterator[Spec]:
    """The cross product of a block whose entries are one value or a list of them."""
    level = block["level"].read(lambda name: load_level(str(name)))
    block = {"peg": _Given(list(level.pegs)), **block}
    for single in _BLOCK.values():
        if single not in block or block[single].value in ([], None):
            with within(*place):
                raise InputError(f"a cell lacks its {single}: give one, or a list of them")
    pegs, conditions, reasoners = (
        _each_once(single, block[single].each()) for single in _BLOCK.values()
    )
    way = block["method"].read(lambda name: level.method if name is None else _name("method", name))
    tasks = [peg.read(lambda name: load_task(_name("peg", name), level.name)) for peg in pegs]
    drawn = [level.on(entry.read(parse_condition)) for entry in conditions]
    minds = [_reasoner(entry, asked) for entry in reasoners]
    for task, drawing, (name, settings) in product(tasks, drawn, minds):
        yield Spec(
            task=task,
            level=level.name,
            condition=drawing,
            seed=0,
            reasoner=name,
            vlm=settings,
            method=way,
        )


def _each_once(what: str, entries: list[_Given]) -> list[_Given]:
    """The entries, none of which may be there twice."""
    for n, entry in enumerate(entries):
        if any(entry.value == other.value for other in entries[:n]):
            named = entry.value.get("name") if isinstance(entry.value, dict) else entry.value
            with within(*entry.place):
                raise InputError(f"{what} '{named}' is given twice: give it once")
    return entries


def _reasoner(given: _Given, asked: Mapping[str, _Given]) -> tuple[str, Settings | None]:
    """A reasoner's name, and its settings if it is a VLM: named vlm, or with settings of its own.

    Raises:
        InputError: the name cannot be used, or is taken; a setting is not valid.
    """
    own = {}
    if isinstance(given.value, dict):
        own = {k: _Given(v, (*given.place, k)) for k, v in given.value.items() if k != "name"}
    name = given.read(_reasoners_name)
    if not isinstance(given.value, dict) and name != VLM:
        return name, None
    settings = {**asked, **own}
    try:
        return name, vlm_settings.from_fields({k: v.value for k, v in settings.items()})
    except InputError as error:
        field = settings.get(str(error.place[0])) if error.place else None
        error.place = field.place if field else given.place
        raise


def _reasoners_name(entry: Any) -> str:
    """The name of a reasoner that can be used; one with settings must be named otherwise."""
    if isinstance(entry, dict):
        name = _name("reasoner's name", entry.get("name"), is_new=True)
        if name in REASONERS or name == oracle.NAME:
            raise InputError(f"reasoner '{name}' is no VLM: one with settings needs another name")
        return name
    return _name("reasoner", entry)


def _named(minds: list[_Given], ways: list[_Given], asked: Mapping[str, _Given]) -> Named:
    """The code that is run and the models that are asked because the file itself names them."""
    code = [w.value for w in ways if w.place and w.value is not None and own_file(w.value)]
    servers = []
    for mind in minds:
        name, settings = _reasoner(mind, asked)
        if settings is None:
            if mind.place and own_file(name) is not None:
                code.append(name)
            continue
        own = mind.value if isinstance(mind.value, dict) else {}
        chosen = {k: bool(v.place) for k, v in asked.items()} | dict.fromkeys(own, bool(mind.place))
        if settings.base_url is not None:
            if chosen["base_url"]:
                servers.append(settings.base_url)
        elif chosen.get("model") and settings.model != SHIPPED:
            servers.append(str(settings.model))
    return Named(code=tuple(dict.fromkeys(code)), servers=tuple(dict.fromkeys(servers)))


def _see_that_it_can_be_made(entry: Any) -> None:
    """Check that a reasoner can be made. Raises InputError where a name is no reasoner's, or its
    code cannot be run."""
    if isinstance(entry, str) and entry not in (VLM, oracle.NAME):
        reasoner(entry)


def parse_condition(entry: Any) -> Condition:
    """A condition from its name, or from a mapping: a name of its own and ranges, such as
    `{name: windy, friction: [1, 3], hole_y_mm: [-10, 10], grasp_roll_deg: [-2, 2]}`.

    Raises:
        InputError: the name is unknown or taken, or a quantity or a range is not valid.
    """
    if not isinstance(entry, dict):
        return condition(_name("condition", entry))
    ranges = dict(entry)
    name = _name("condition's name", ranges.pop("name", None), is_new=True)
    if name in CONDITIONS:
        raise InputError(f"condition '{name}' is the paper's: a custom one needs another name")
    drawn: dict[str, tuple[float, float]] = {}
    for field, value in ranges.items():
        with within(field):
            drawn.update([_range(name, field, value)])
    return Condition(name=name, ranges=drawn)


def _range(name: str, field: str, value: Any) -> tuple[str, tuple[float, float]]:
    """The quantity and its range in SI units that a field of a condition says."""
    if field not in FIELDS:
        raise unknown("quantity", field, FIELDS, f"in condition '{name}'")
    numbers = isinstance(value, list) and all(
        isinstance(v, int | float) and not isinstance(v, bool) for v in value
    )
    if not numbers or len(value) != 2:
        raise InputError(f"condition '{name}': {field} is {value!r}; it must be [low, high]")
    quantity, axis = FIELDS[field]
    low, high = (float(v) if axis is None else axis.from_report(float(v)) for v in value)
    check_range(f"condition '{name}': {field}", quantity, low, high)
    return quantity, (low, high)


def _name(what: str, value: Any, *, is_new: bool = False) -> str:
    """A name in the file: of something that there is, where whoever looks it up says what is valid;
    or one that `is_new`, which the file gives to something, and may not be empty."""
    if not isinstance(value, str) or (is_new and not value):
        raise InputError(f"{what} is {value!r}: it must be a name")
    return value
