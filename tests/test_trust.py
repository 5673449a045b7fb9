"""An experiment file from somebody else: the code and the models that it names are not used before
a person has agreed."""

import sys
from pathlib import Path

import pytest
from a_terminal import Terminal
from documents import ROOT

from pliant.cli import main
from pliant.errors import InputError
from pliant.experiment import plan
from pliant.experiment.trust import Named

PLIANT = Path(sys.executable).parent / "pliant"
CODE = "from pathlib import Path\n(Path(__file__).parent / 'ran').touch()\n"
SERVER = "http://192.0.2.1:8000/v1"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """What a stranger sends: code that says that it ran, and holds no reasoner."""
    (tmp_path / "mine.py").write_text(CODE, encoding="utf-8")
    return tmp_path


def sent(folder: Path, text: str) -> Path:
    file = folder / "theirs.yaml"
    grid = "" if "cells:" in text else "pegs: circle\nconditions: all\n"
    file.write_text(f"{grid}trials: 1\n{text}", encoding="utf-8")
    return file


def ended(
    capsys: pytest.CaptureFixture[str], patch: pytest.MonkeyPatch, *words: str | Path
) -> tuple[int, str, str]:
    """`pliant` without a terminal: its exit status, and what it says."""
    patch.setattr(sys, "argv", ["pliant", *map(str, words)])
    with pytest.raises(SystemExit) as end:
        main()
    said = capsys.readouterr()
    return int(end.value.code or 0), said.out, said.err


REASONERS = {
    "a list": "reasoners: [rules, mine.py:Mine]\n",
    "one name": "reasoners: mine.py:Mine\n",
    "a cell": "cells:\n- {peg: circle, condition: none, reasoner: [rules, mine.py:Mine]}\n",
    "a method": "reasoners: rules\nmethod: mine.py:Mine\n",
    "a cell's method": (
        "cells:\n- {peg: circle, condition: none, reasoner: rules, method: mine.py:Mine}\n"
    ),
    "a way round": "reasoners: ../{folder}/mine.py:Mine\n",
}


@pytest.mark.parametrize("text", REASONERS.values(), ids=REASONERS)
def test_code_that_a_file_names_is_not_run_unasked(
    text: str, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = sent(folder, text.replace("{folder}", folder.name))
    out = folder / "out"
    status, _, said = ended(capsys, monkeypatch, "experiment", file, "--out", out)
    assert status == 2
    assert said.count("\n") == 1
    assert f"{folder.name}/mine.py:Mine" in said
    assert "--trust agrees" in said
    assert not (folder / "ran").exists()
    assert not out.exists()


def test_code_that_is_agreed_to_beforehand_is_named_and_run(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = sent(folder, "reasoners: mine.py:Mine\n")
    status, _, said = ended(capsys, monkeypatch, "experiment", file, "--trust")
    told, refused = said.splitlines()
    assert f"code that will be run: {folder}/mine.py:Mine" in told
    assert (folder / "ran").exists()
    assert status == 2
    assert "has no class 'Mine'" in refused


@pytest.mark.parametrize(("answer", "runs"), [("n\n", False), ("\n", False), ("y\n", True)])
def test_a_person_at_a_terminal_is_asked(answer: str, runs: bool, folder: Path) -> None:
    file = sent(folder, "reasoners: mine.py:Mine\n")
    with Terminal([PLIANT, "experiment", file, "--out", folder / "out"]) as terminal:
        assert f"{folder}/mine.py:Mine" in terminal.until(r"Go on\?").replace("\r\n", "")
        assert not (folder / "ran").exists()
        terminal.press(answer)
        status, last = terminal.ended()
    assert status == 2
    assert (folder / "ran").exists() is runs
    assert ("not agreed" in last) is not runs


def test_code_that_a_person_names_at_the_command_line_is_theirs(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = sent(folder, "reasoners: mine.py:Theirs\n")
    (folder / "my.py").write_text("", encoding="utf-8")
    words = ("experiment", file, "--reasoners", f"{folder}/my.py:Mine")
    status, told, said = ended(capsys, monkeypatch, *words)
    assert status == 2
    assert "my.py' has no class 'Mine'" in said
    assert (told, said.count("\n")) == ("", 1)
    assert not (folder / "ran").exists()


MODELS = {
    "of all": (f"reasoners: vlm\nvlm: {{model: small, base_url: '{SERVER}'}}\n", SERVER),
    "of one": (f"reasoners: [{{name: a, model: small, base_url: '{SERVER}'}}]\n", SERVER),
    "of a cell": (
        "cells:\n- peg: circle\n  condition: all\n  reasoner: {name: a, model: small, base_url: "
        f"'{SERVER}'}}\n",
        SERVER,
    ),
    "a provider's": ("reasoners: vlm\nvlm: {model: 'openai:gpt-4o'}\n", "openai:gpt-4o"),
}


@pytest.mark.parametrize(("text", "named"), MODELS.values(), ids=MODELS)
def test_a_model_that_a_file_names_is_not_asked_unasked(
    text: str,
    named: str,
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    status, _, said = ended(capsys, monkeypatch, "experiment", sent(folder, text), "--yes")
    assert status == 2
    assert said.count("\n") == 1
    assert f"asked, and shown the cell's pictures: {named}" in said
    assert "--trust agrees" in said


def names(folder: Path, text: str, **overrides: object) -> Named:
    told: list[Named] = []
    plan.load(sent(folder, text), overrides, agree=told.append)
    (named,) = told
    return named


def test_what_is_typed_is_not_asked_for_and_what_overrules_it_is(folder: Path) -> None:
    typed = {"vlm": {"model": "small", "base_url": "http://localhost:1/v1"}}
    assert names(folder, MODELS["of all"][0], **typed) == Named()
    assert names(folder, "reasoners: vlm\nvlm: {picture: false}\n", **typed) == Named()
    assert names(folder, "reasoners: [{name: a, picture: false}]\n", **typed) == Named()
    # the setting of one reasoner goes before what is typed for all
    assert names(folder, MODELS["of one"][0], **typed) == Named(servers=(SERVER,))
    assert names(folder, "reasoners: vlm\nvlm: {model: big}\n", **typed) == Named()
    named = "reasoners: vlm\nvlm: {model: 'openai:gpt-4o'}\n"
    assert names(folder, named, vlm={"model": "openai:gpt-4o"}) == Named()


def test_data_is_not_asked_for(folder: Path) -> None:
    assert names(folder, "reasoners: [rules, oracle, none]\n") == Named()
    assert names(folder, MODELS["of all"][0], reasoners=["rules"]) == Named()


def test_from_python_too_a_file_is_data_unless_told_otherwise(folder: Path) -> None:
    with pytest.raises(InputError, match=r"theirs.yaml': it names code that will be run: .*mine"):
        plan.load(sent(folder, "reasoners: mine.py:Mine\n"))
    assert not (folder / "ran").exists()


def test_what_is_malformed_is_refused_before_anyone_is_asked(folder: Path) -> None:
    with pytest.raises(InputError, match="unknown peg"):
        plan.load(sent(folder, "cells:\n- {peg: s, condition: all, reasoner: mine.py:Mine}\n"))
    assert not (folder / "ran").exists()


def test_the_advisers_of_this_checkout_are_agreed_to_by_their_script() -> None:
    script = (ROOT / "reproduce" / "advisers.sh").read_text(encoding="utf-8")
    assert "reproduce/advisers.yaml --trust" in script
