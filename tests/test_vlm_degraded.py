"""A run whose model did not decide is louder than one whose model did: on the terminal, in the
tables, on the page and in the exit status."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from loopback import Handler, Loopback, completion, loopback
from stand_ins import cell_for
from test_tables import made
from vlm_cases import asking, blind, simulated
from voices import judgement

from pliant.cli.model import UNDECIDED, ModelOptions
from pliant.cli.run import run
from pliant.errors import InputError
from pliant.experiment import measures, plan, results, runner, tables
from pliant.experiment.attended import Attended
from pliant.experiment.bench import run as bench
from pliant.experiment.bench import table
from pliant.experiment.bench.cases import SHIPPED, Cases
from pliant.experiment.cells import Experiment
from pliant.experiment.progress import Silent
from pliant.experiment.tables_text import markdown
from pliant.reasoners import first_answer
from pliant.reasoners.rules import Rules
from pliant.reasoners.vlm.settings import Decider, Settings
from pliant.report.overview_tables import table2

Behave = Callable[[Loopback, Handler], None]


@pytest.fixture(autouse=True)
def own_server(monkeypatch: pytest.MonkeyPatch) -> None:
    """See conftest.py. A picture is drawn, and its cell given up, in one thread only: what is right
    to say is known before a server's thread is asked, and the cell is one that stays."""
    simulated()
    monkeypatch.setattr("pliant.sim.cell.SimCell", lambda: cell_for("circle"))


@pytest.fixture
def no_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """A page takes longer than a trial."""
    monkeypatch.setattr("pliant.report.trial.write", lambda *_, **__: None)


def refused(server: Loopback, handler: Handler) -> None:
    handler.send(b'{"error": {"message": "no such \\u001b[31mmodel"}}', status=404)


def words(server: Loopback, handler: Handler) -> None:
    handler.send(completion(handler.received.body, "I cannot see images."))


def answers(handler: Handler) -> None:
    """What is right to say of whatever is asked first or judged: every skill succeeded."""
    fields = judgement(Rules().judge(simulated().put[-1]))
    if "asked whether you can be asked" in json.dumps(handler.received.body):
        fields = {"colour": "green"}
    handler.send(completion(handler.received.body, json.dumps(fields)))


def trusting(server: Loopback, handler: Handler) -> None:
    answers(handler)


def soon_gone(server: Loopback, handler: Handler) -> None:
    (answers if len(server.received) < 3 else lambda h: refused(server, h))(handler)


def options(server: Loopback, **rest: Any) -> ModelOptions:
    given = {"model": "small", "base_url": server.base_url, "picture": False}
    return ModelOptions(vlm=given, **rest)


def ran(behave: Behave, folder: Path, **rest: Any) -> tuple[int, int]:
    """The exit status of a run on the nominal condition, and how many requests it sent."""
    with loopback(behave) as server:
        status = run(
            reasoner="vlm",
            condition="none",
            video=False,
            out=folder / "run",
            model=options(server, **rest),
        )
        return status, len(server.received)


# --- one run -------------------------------------------------------------------------------------


def test_a_model_that_decides_nothing_is_said_at_each_decision_and_ends_with_status_3(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, _ = ran(refused, tmp_path, fallback_from_start=True)
    told = capsys.readouterr().out
    assert status == UNDECIDED == 3
    assert told.count("the rules judged in the model's place: ") == 3
    assert "the rules judged in the model's place: 404: no such \N{REPLACEMENT CHARACTER}" in told
    assert told.splitlines()[-1] == "the model decided 0 of 3 decisions; 3 by the rules"
    assert "\x1b[31mmodel" not in told
    (page,) = tmp_path.glob("run/trials/*/index.html")
    text = page.read_text(encoding="utf-8")
    assert "The model decided 0 of 3 decisions; 3 by the rules" in text
    assert text.count("judged by the rules") == 3


@pytest.mark.usefixtures("no_page")
def test_a_model_that_decides_some_is_counted_and_the_outcome_says_the_status(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, _ = ran(soon_gone, tmp_path)
    told = capsys.readouterr().out
    assert status == 0
    assert told.count("the rules judged in the model's place: 404") == 2
    assert told.splitlines()[-1] == "the model decided 1 of 3 decisions; 2 by the rules"


@pytest.mark.usefixtures("no_page")
def test_a_model_that_decides_all_is_counted_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with loopback(trusting) as server:
        status = run(
            reasoner="vlm",
            condition="none",
            video=False,
            json=True,
            out=tmp_path / "run",
            model=options(server),
        )
    told = capsys.readouterr()
    assert status == 0
    assert "in the model's place" not in told.err
    assert told.err.splitlines()[-1] == "the model decided 3 of 3 decisions"
    row = json.loads(told.out)
    assert (row["decisions"], row["own"], row["fallbacks"]) == (3, 3, 0)


@pytest.mark.usefixtures("no_page")
def test_a_reply_that_cannot_be_used_is_said_first_and_does_not_end_the_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, _ = ran(words, tmp_path)
    first, *_ = capsys.readouterr().out.splitlines()
    assert status == UNDECIDED
    assert first.startswith("model 'small', asked first (")
    assert "gave no usable reply: not the structure that was asked for: Invalid JSON" in first


def test_without_the_rules_nothing_is_the_models_where_it_says_nothing(tmp_path: Path) -> None:
    case = blind()
    verdict = asking(lambda m, i: (_ for _ in ()).throw(OSError("gone")), fallback=False).judge(
        case
    )
    assert verdict.is_asked
    assert not verdict.is_own


# --- the first request ---------------------------------------------------------------------------


@pytest.mark.parametrize("code", [400, 401, 403, 404, 413, 422])
def test_a_refused_first_request_ends_the_run_before_anything_moves(
    code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def behave(server: Loopback, handler: Handler) -> None:
        handler.send(b'{"error": {"message": "no"}}', status=code)

    command = sys.modules["pliant.cli.run"]  # the package has a function of that name
    monkeypatch.setattr(command, "_simulated", None)  # where the arm would be prepared
    with pytest.raises(
        InputError,
        match=f"model 'small' cannot be asked: {code}: no; (.*; )?nothing has",
    ):
        ran(behave, tmp_path)
    assert not (tmp_path / "run").exists()


def test_the_first_request_is_small_and_shows_a_picture_as_every_other_does() -> None:
    with loopback(trusting) as server:
        found = first_answer(Settings(model="small", base_url=server.base_url))
    assert found is not None
    assert (found.problem, found.is_final) == ("", False)
    (received,) = server.received
    said = json.dumps(received.body)
    assert "data:image/png;base64" in said
    assert len(said) < 5000
    assert received.body["response_format"]["type"] == "json_schema"
    assert received.body["max_tokens"] == 8000
    assert str(found).endswith("960 tokens")


@pytest.mark.parametrize(("code", "is_final"), [(429, False), (503, False), (402, True)])
def test_what_may_pass_does_not_end_a_run(code: int, is_final: bool) -> None:
    def behave(server: Loopback, handler: Handler) -> None:
        told = b'{"error": {"message": "not now", "code": "insufficient"}}'
        handler.send(told, status=code, retry_after="0")

    with loopback(behave) as server:
        found = first_answer(Settings(model="small", base_url=server.base_url))
    assert found is not None
    assert found.problem.startswith(f"{code}: not now")
    assert found.is_final is is_final


def test_no_answer_in_time_and_nobody_there_are_final() -> None:
    def never(server: Loopback, handler: Handler) -> None:
        server.stopped.wait()
        handler.drop()

    with loopback(never) as server:
        late = first_answer(Settings(model="small", base_url=server.base_url, deadline_s=0.3))
    nobody = first_answer(Settings(model="small", base_url=server.base_url))
    assert late is not None
    assert nobody is not None
    assert late.is_final
    assert nobody.is_final
    assert nobody.problem.endswith("failed: Connection refused")


def test_a_model_that_no_decision_is_asked_of_is_not_asked_first() -> None:
    assert first_answer(Settings(judge=Decider.RULES, recover=Decider.RULES)) is None


# --- many trials ---------------------------------------------------------------------------------


def planned(server: Loopback) -> Experiment:
    vlm = {"model": "small", "base_url": server.base_url, "picture": False, "recover": "rules"}
    return plan.from_fields(
        {
            "pegs": "circle",
            "conditions": ["none"],
            "reasoners": ["vlm", {"name": "same"}, {"name": "short", "reply_tokens": 50}],
            "trials": 1,
            "vlm": vlm,
        }
    )


class _Told(Silent):
    def __init__(self) -> None:
        self.said: list[str] = []

    def say(self, text: str) -> None:
        self.said.append(text)


def performed(server: Loopback, folder: Path, **rest: Any) -> list[str]:
    told, experiment = _Told(), planned(server)
    engine = Attended(cell_for("circle"), experiment)
    runner.run(experiment, folder, engine=engine, watcher=told, **rest)
    return told.said


def test_each_setting_is_asked_once_and_only_for_trials_that_are_missing(tmp_path: Path) -> None:
    def first_requests() -> int:
        said = (json.dumps(request.body) for request in server.received)
        return sum("asked whether you can be asked" in text for text in said)

    with loopback(trusting) as server:
        said = performed(server, tmp_path)
        assert first_requests() == 2
        performed(server, tmp_path)
        assert first_requests() == 2
    assert [text for text in said if "asked first, answered" in text] == said
    with loopback(refused) as server, pytest.raises(InputError, match="cannot be asked: 404"):
        performed(server, tmp_path / "other")
    assert len(server.received) == 1


def test_a_row_that_is_the_rules_bears_their_name_in_every_table(tmp_path: Path) -> None:
    with loopback(refused) as server:
        said = performed(server, tmp_path, fallback_from_start=True)
    assert [text.partition(":")[0] for text in said] == [
        "L0, circle, none, vlm",
        "L0, circle, none, same",
        "L0, circle, none, short",
    ]
    assert "the model decided 0 of 3 decisions; 3 by the rules in trial" in said[0]
    assert ": 404: no such \N{REPLACEMENT CHARACTER}[31mmodel; see that --model" in said[0]
    text = markdown(tables.build(tmp_path))
    assert "| circle | none | rules (for vlm (small)) | 1 |" in text
    assert "| vlm" not in text
    assert "rules (for same) − rules (for vlm)" in text
    assert "rules (for …): the model that was asked decided nothing" in text


# --- tables --------------------------------------------------------------------------------------

ASKED: dict[str, Any] = {"decisions": 10, "model": "gpt"}


def test_a_models_row_has_its_own_share_beside_f_and_g_and_a_mark_below_all(tmp_path: Path) -> None:
    rows = [
        made(1, True, reasoner="vlm", **ASKED, own=10),
        made(2, True, reasoner="vlm", **ASKED, own=5, fallbacks=5),
        made(1, True, reasoner="rules"),
    ]
    results.write_rows(tmp_path, rows)
    document = tables.build(tmp_path)
    text = markdown(document)
    whole, half = "100.0 [34.2, 100.0] of 2", "50.0 [9.5, 90.5] of 2"
    assert "| F [%] | G [%] | own [%] | G alone [%] |" in text
    assert f"| vlm (gpt) † | 2 | {whole} | {whole} | 75.0 | {half} |" in text
    assert "| rules | 1 | 100.0 [20.7, 100.0] of 1 | 100.0 [20.7, 100.0] of 1 | – | – |" in text
    assert "† Not every decision was the model's own" in text
    page = str(table2(document["cells"]))
    assert "vlm (gpt) †" in page
    assert "own [%]" in page
    assert "† Not every decision" in page


def test_a_model_that_decided_all_has_no_mark(tmp_path: Path) -> None:
    results.write_rows(tmp_path, [made(1, True, reasoner="vlm", **ASKED, own=10)])
    text = markdown(tables.build(tmp_path))
    assert "| vlm (gpt) | 1 |" in text
    assert "†" not in text


def test_tables_without_a_model_know_nothing_of_one(tmp_path: Path) -> None:
    results.write_rows(tmp_path, [made(1, True), made(1, False, reasoner="none")])
    document = tables.build(tmp_path)
    text = markdown(document) + str(table2(document["cells"]))
    assert not [word for word in ("own", "alone", "†", "for …") if word in text.split()]
    assert "own [%]" not in text


@pytest.mark.parametrize(
    ("share", "name"),
    [
        (None, "vlm"),
        ({"own_percent": 100, "clamped": 0, "fallbacks": 0}, "vlm"),
        ({"own_percent": 0, "clamped": 2, "fallbacks": 1}, "vlm"),  # cut down, and yet its plans
        ({"own_percent": 0, "clamped": 0, "fallbacks": 9}, "rules (for vlm)"),
        ({"own_percent": 0, "clamped": 0, "fallbacks": 0}, "nobody (for vlm)"),
    ],
)
def test_trials_are_called_by_who_decided(share: dict[str, Any] | None, name: str) -> None:
    assert measures.name("vlm", share) == name


# --- the benchmark -------------------------------------------------------------------------------


def test_the_benchmark_gives_no_marks_to_a_model_that_decided_nothing() -> None:
    def gone(*_: Any) -> Any:
        raise OSError("gone")

    makers = {
        "vlm (gone)": lambda _: asking(gone, picture=False, goal_picture=False),
        "rules": lambda _: Rules(),
    }
    document = bench.run(makers, Cases(SHIPPED), limit=3)  # type: ignore[arg-type]
    text = table.markdown(document)
    assert table.undecided(document) == ["vlm (gone)"]
    assert "| rules (for vlm (gone)) | 3 | 0.0 |" in text
    assert "| vlm (gone)" not in text
    assert "| rules | 3 | – |" in text
    assert "It says nothing of the model." in text
