"""A wrong command line is answered in one line, nothing is written, and help says what is right."""

import sys
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import pytest

from pliant import errors
from pliant.cli import COMMANDS, main
from pliant.cli.model import GROUPS
from pliant.reasoners.vlm.settings import Settings
from pliant.usage import options

WRONG = {
    "rnu": "did you mean 'run'",
    "export": "FOLDER",
    "tables": "FOLDER",
    "--colour red": "unknown command",
    "run --colour red": "unknown option '--colour'",
    "run --vidoe": "did you mean '--video'",
    "run --hole-y 3 5": "did you mean '--hole-y-mm'",
    "run -peg circle": "'-peg' is no option, nor the value of one; did you mean '--peg'",
    "run --trials 3": "unknown option '--trials'; pliant run --help lists them",
    "experiment --seed 3": "did you mean '--first-seed'",
    "calibrate --peg-at 3": "--peg-at takes two values: whole numbers",
    "run --usd-per-million 1": "--usd-per-million takes two values: numbers",
    "run circle": "'circle' is no option",
    "run --peg": "--peg takes a value",
    "run --peg sqare": "did you mean 'square'",
    "run --peg missing.yaml": "missing.yaml",
    "run --condition poze": "did you mean 'pose'",
    "run --level L99": "unknown level 'L99'",
    "run --level wrong_pegg": "did you mean 'wrong_peg'",
    "run --reasoner rule": "did you mean 'rules'",
    "run --reasoner mine.py:Mine": "mine.py",
    "run --method guidde": "did you mean 'guided'",
    "run --method guided-eaze": "did you mean 'ease'",
    "run --seed x": "--seed is 'x': it must be a whole number",
    "run --seed 1.5": "--seed is '1.5': it must be a whole number",
    "run --seed -1": "--seed is -1: it must be a whole number from 0",
    "run --hole-y-mm 3": "--hole-y-mm takes two values: the least and the most",
    "run --hole-y-mm a b": "--hole-y-mm takes two values",
    "run --hole-y-mm 9 3": "pliant: --hole-y-mm from 9 mm to 3 mm cannot be; it must lie",
    "experiment --grasp-roll-deg 0 90": "pliant: --grasp-roll-deg from 0 deg to 90 deg cannot be",
    "experiment mine.yaml --friction 1 2": "--friction is drawn in place of a condition's",
    "bench-reasoner rules coin rules": "reasoner 'rules' is given twice",
    "experiment --reasoners rules rules": "reasoner 'rules' is given twice: give it once",
    "experiment --pegs circle square circle": "peg 'circle' is given twice",
    "experiment --conditions all all --friction 1 2": "condition 'all-own' is given twice",
    "experiment --first-seed -1": "--first-seed is -1",
    "run --peg=": "unknown peg '': valid are circle",
    "run --condition=": "unknown condition ''",
    "run --reasoner=": "unknown reasoner ''",
    "run --method=": "unknown method ''",
    "run --dry-run --air": "--dry-run and --air are two ways to rehearse: leave one of them out",
    "run --effort extreme": "--effort is 'extreme': it must be low or medium or high",
    "run --effort hihg": "did you mean 'high'",
    "run --preset papr": "did you mean 'paper'",
    "run --output json": "it must be tool or native or prompted",
    "run --temperature hot": "--temperature",
    "run --model openai:gpt-4o": "--model is for a VLM",
    "run --reasoner vlm --base-url nowhere": "base_url",
    "run --goals nowhere.yaml": "nowhere.yaml",
    "run --cell nowhere.yaml": "nowhere.yaml",
    "experiment nowhere.yaml": "nowhere.yaml",
    "experiment --trials 0": "trials is 0",
    "experiment --trials many": "--trials is 'many': it must be a whole number",
    "experiment --pegs circle sqare": "did you mean 'square'",
    "experiment --save some": "it must be failures or all or none",
    "experiment --again faults": "holds no experiment, so there is nothing to repeat: leave",
    "experiment --pegs circle --pegs square": "--pegs is given twice: write all values behind one",
    "run --seed 1 --seed 2": "--seed is given twice: leave one out",
    "run --seed=1 --seed 1": "--seed is given twice",
    "run --video --no-video": "--video is given twice",
    "run --hole-y-mm 1 2 --hole_y_mm 3 4": "--hole-y-mm is given twice",
    "run --preset paper --preset paper": "--preset is given twice",
    "export X --trial A --trial B --lerobot y": "--trial is given twice: write all values behind",
    "export X --trial --lerobot y": "--trial takes one trial_id or several",
    "experiment --again everything": "--again is 'everything'",
    "experiment --workers 0": "workers is 0",
    "experiment --time-limit-s -3": "time limit",
    "view nowhere": "'nowhere' does not exist: name the result folder",
    "tables nowhere": "'nowhere' does not exist: name the result folder",
    "view nowhere --port": "--port takes a value",
    "export nowhere --lerobot data": "'nowhere' does not exist: name the result folder",
    "export nowhere": "give --lerobot",
    "export --lerobto data nowhere": "did you mean '--lerobot'",
    "bench-reasoner ruless": "did you mean 'rules'",
    "bench-reasoner rules --limit none": "--limit",
    "calibrate camra": "did you mean 'camera'",
    "label nowhere": "run this in a terminal",
}


@pytest.fixture
def refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., str]:
    """The one line with which a command line is refused, with status 2 and
    nothing on standard output."""

    def line(*words: str) -> str:
        monkeypatch.setattr(sys, "argv", ["pliant", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        assert ended.value.code == 2
        printed, complained = capsys.readouterr()
        assert printed == ""
        (said,) = complained.splitlines()
        return said

    return line


@pytest.mark.parametrize(("line", "answer"), WRONG.items(), ids=list(WRONG))
def test_a_wrong_command_line_is_answered_in_one_line(
    line: str,
    answer: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    refused: Callable[..., str],
) -> None:
    monkeypatch.chdir(tmp_path)
    said = refused(*line.split())
    assert said.startswith("pliant: ")
    assert answer in said
    assert [*tmp_path.iterdir()] == []


@pytest.mark.parametrize("held", [(), ("note.txt",)], ids=["nothing", "a note"])
@pytest.mark.parametrize("line", ["view {}", "tables {}", "export {} --lerobot data"])
def test_a_folder_that_pliant_did_not_write_is_refused_in_the_same_words_everywhere(
    line: str, held: tuple[str, ...], tmp_path: Path, refused: Callable[..., str]
) -> None:
    for name in held:
        (tmp_path / name).touch()
    said = refused(*line.format(tmp_path).split())
    assert f"'{tmp_path}' holds no results of pliant: name the result folder of" in said
    assert sorted(path.name for path in tmp_path.iterdir()) == [*held]


@pytest.mark.parametrize("command", ["run", "experiment"])
def test_a_file_of_ones_own_that_is_no_python_is_named_with_its_line_and_no_other(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: Callable[..., str]
) -> None:
    (tmp_path / "own.py").write_text("\nclass Mine\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    said = refused(command, "--cell", "own.py:Mine")
    assert said.endswith("cannot be made: SyntaxError: expected ':' (own.py:2)")


def test_an_option_beside_a_preset_that_has_it_too_is_no_repeat(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: Callable[..., str]
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["run", "--preset", "paper", "--plan", "bounded", "--judge", "rules", "--peg", "x"]
    said = refused(*words)
    assert said.startswith("pliant: unknown peg 'x'")


def test_a_class_that_a_file_does_not_have_is_answered_with_those_it_has(
    tmp_path: Path, refused: Callable[..., str]
) -> None:
    own = tmp_path / "own.py"
    own.write_text("class Careful: ...\n", encoding="utf-8")
    said = refused("run", "--reasoner", f"{own}:Carful")
    assert "has no class 'Carful': it has Careful; did you mean 'Careful'?" in said


@pytest.fixture
def help_of(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[[str], list[str]]:
    monkeypatch.setenv("COLUMNS", "100")

    def lines(words: str) -> list[str]:
        monkeypatch.setattr(sys, "argv", ["pliant", *words.split()])
        with pytest.raises(SystemExit) as ended:
            main()
        assert not ended.value.code
        return capsys.readouterr().out.splitlines()

    return lines


def test_the_help_of_run_fits_two_screens(help_of: Callable[[str], list[str]]) -> None:
    lines = help_of("run --help")
    assert len(lines) <= 100
    assert max(map(len, lines)) <= 100


@pytest.mark.parametrize("name", COMMANDS)
def test_a_page_of_help_has_examples_and_explains_every_option(
    name: str, help_of: Callable[[str], list[str]]
) -> None:
    lines = help_of(f"{name} --help")
    assert sum(line.startswith("  pliant ") for line in lines) >= 3
    for option in options(COMMANDS[name][0]):
        assert option.meaning, option.name
        assert any(line.strip().startswith(option.written) for line in lines), option.name


def test_the_first_page_names_every_command(help_of: Callable[[str], list[str]]) -> None:
    lines = help_of("--help")
    for name in COMMANDS:
        assert any(line.startswith(f"  {name} ") for line in lines)


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_a_shell_is_told_how_to_complete_commands_and_options(
    shell: str, help_of: Callable[[str], list[str]]
) -> None:
    script = "\n".join(help_of(f"--tyro-print-completion {shell}"))
    assert "bench-reasoner" in script
    assert "hole-y-mm" in script


def test_every_setting_of_a_model_stands_in_a_group_of_the_help() -> None:
    grouped = {name.replace("-", "_") for names in GROUPS.values() for name in names}
    assert {f.name for f in fields(Settings)} <= grouped


def test_an_extra_is_asked_for_by_a_command_that_the_environment_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / ".venv").mkdir()
    monkeypatch.setattr(sys, "prefix", str(tmp_path / ".venv"))
    monkeypatch.setattr(errors, "find_spec", lambda name: None)
    assert errors.installing("gym") == "pip install '.[gym]' in a checkout"
    (tmp_path / ".tools" / "bin").mkdir(parents=True)
    (tmp_path / ".tools" / "bin" / "uv").touch()
    asked = errors.installing("gym")
    assert asked == ".tools/bin/uv pip install -e '.[gym]' in the checkout"
