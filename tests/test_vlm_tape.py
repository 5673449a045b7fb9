"""Recordings: replayed they give the same decisions without a model, damaged they are refused."""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic_ai.messages import ModelMessage, ModelResponse, TextPart
from pydantic_ai.models.function import AgentInfo
from vlm_cases import asking, simulated
from voices import SpeaksForRules

from pliant.errors import InputError
from pliant.reasoners import vlm
from pliant.reasoners.vlm.reasoner import Vlm
from pliant.reasoners.vlm.settings import Output, Plans, Settings
from pliant.reasoners.vlm.tape import Recorder, Replayer, Reply, Request
from pliant.records import Case, Recovery, Verdict

SETTINGS = Settings(model="scripted", deadline_s=20, history=2)


def decisions(mind: Vlm) -> list[Verdict | Recovery | None]:
    """Of a whole trial: each verdict, and each recovery from a failure."""
    told: list[Verdict | Recovery | None] = [mind.judge(case) for case in simulated().judged]
    return told + [mind.recover(case, verdict) for case, verdict in simulated().recovered]


def recorded(path: Path, settings: Settings = SETTINGS) -> list[Verdict | Recovery | None]:
    return decisions(SpeaksForRules(settings=settings, tape=Recorder(path)))


def replayed(path: Path, settings: Settings = SETTINGS) -> Vlm:
    mind = vlm(settings, replay=path)
    assert isinstance(mind, Vlm)
    return mind


def told(decision: Verdict | Recovery | None) -> Any:
    """What a decision says, without how it came about."""
    assert decision is not None
    return replace(decision, exchanges=())


@cache
def a_recording() -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "tape.jsonl"
        mind = SpeaksForRules(settings=SETTINGS, tape=Recorder(path))
        mind.judge(simulated().put[-1])
        mind.recover(*simulated().recovered[0])
        return path.read_bytes()


# --- record and replay ---------------------------------------------------------------------------


@pytest.mark.parametrize("output", list(Output))
@pytest.mark.parametrize("plan", list(Plans))
def test_a_replay_decides_as_was_recorded_without_the_model(
    plan: Plans, output: Output, tmp_path: Path
) -> None:
    settings = replace(SETTINGS, plan=plan, output=output, one_call=plan is Plans.BOUNDED)
    path = tmp_path / "deep" / "tape.jsonl"
    first = recorded(path, settings)
    again = decisions(replayed(path, settings))
    assert list(map(told, again)) == list(map(told, first))
    for one, other in zip(first, again, strict=True):
        assert one is not None
        assert other is not None
        assert [e.reply for e in one.exchanges] == [e.reply for e in other.exchanges]
        assert [e.tokens for e in one.exchanges] == [e.tokens for e in other.exchanges]
        assert not any(e.note for e in other.exchanges)


def test_refusals_and_failures_are_replayed_too(tmp_path: Path) -> None:
    replies = ["no JSON", "still none", ConnectionError("gone")]

    def answer(messages: list[ModelMessage], info: AgentInfo) -> ModelResponse:
        said = replies.pop(0)
        if isinstance(said, Exception):
            raise said
        return ModelResponse(parts=[TextPart(str(said))])

    path = tmp_path / "tape.jsonl"
    cases = simulated().put[:2]
    recording = asking(answer)
    recording = replace(recording, tape=Recorder(path))
    first = [recording.judge(case) for case in cases]
    replaying = replayed(path, recording.settings)
    again = [replaying.judge(case) for case in cases]
    for one, other in zip(first, again, strict=True):
        assert (other.by, other.success) == (one.by, one.success) == ("rules", one.success)
        assert [e.refused for e in other.exchanges] == [e.refused for e in one.exchanges]
    assert "gone" in again[1].fallback


def test_each_picture_is_kept_once(tmp_path: Path) -> None:
    path = tmp_path / "tape.jsonl"
    recorded(path)
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    names = [line["picture"] for line in lines if "picture" in line]
    shown = [name for line in lines for name in line.get("pictures", ())]
    assert len(names) == len(set(names))
    assert set(names) == set(shown)
    assert len(shown) > len(names)  # the picture that was judged is analysed too


def test_a_recording_says_what_made_it(tmp_path: Path) -> None:
    path = tmp_path / "tape.jsonl"
    recorded(path)
    head, *lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    assert {"pliant", "pydantic-ai-slim", "openai"} <= set(head["versions"])
    exchange = next(line for line in lines if "request" in line)
    assert exchange["request"]["sampling"] == {"temperature": 0.0, "max_tokens": 8000}
    assert exchange["reply"]["usage"]["output_tokens"] > 0
    assert exchange["latency_s"] >= 0


def with_another_picture(case: Case) -> Case:
    look = case.outcome.looks[-1]
    view = look.observation.views["side"]
    image = view.image.copy()
    image[0, 0] ^= 1
    views = {"side": replace(view, image=image)}
    seen = replace(look, observation=replace(look.observation, views=views))
    return replace(case, outcome=replace(case.outcome, looks=(seen,)))


def test_a_picture_drawn_differently_is_noted_and_not_fatal(tmp_path: Path) -> None:
    path = tmp_path / "tape.jsonl"
    case = simulated().put[0]
    first = SpeaksForRules(settings=SETTINGS, tape=Recorder(path)).judge(case)
    again = replayed(path).judge(with_another_picture(case))
    assert told(again) == told(first)
    assert "picture differs" in again.exchanges[0].note


def test_a_replay_that_asks_something_else_says_what_differs(tmp_path: Path) -> None:
    path = tmp_path / "tape.jsonl"
    case = simulated().put[0]
    SpeaksForRules(settings=SETTINGS, tape=Recorder(path)).judge(case)
    with pytest.raises(InputError, match=r"request 1: it differs .* sampling: .*0\.5") as raised:
        replayed(path, replace(SETTINGS, temperature=0.5)).judge(case)
    assert "\n" not in str(raised.value)
    with pytest.raises(InputError, match="pose_check"):
        replayed(path, replace(SETTINGS, pose_check=False)).judge(case)
    mind = replayed(path)
    mind.judge(case)
    with pytest.raises(InputError, match="has ended: all its 1 replies are used"):
        mind.judge(case)


# --- files ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [Recorder, Replayer])
def test_a_file_that_cannot_be_used_is_refused(
    make: Callable[[Path], object], tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=r"cannot be (written|read)"):
        make(tmp_path)


def test_what_is_no_recording_is_not_written_over(tmp_path: Path) -> None:
    thesis = tmp_path / "thesis.tex"
    thesis.write_text("important", encoding="utf-8")
    with pytest.raises(InputError, match="something else than a recording"):
        Recorder(thesis)
    assert thesis.read_text(encoding="utf-8") == "important"
    recorded(tape := tmp_path / "tape.jsonl")
    Recorder(tape)  # an earlier recording is
    assert len(tape.read_text(encoding="utf-8").splitlines()) == 1


@pytest.mark.parametrize("target", ["nothing", "empty", "earlier.jsonl"])
def test_a_recording_is_not_written_through_a_link(target: str, tmp_path: Path) -> None:
    mine = tmp_path / target
    if target == "empty":
        mine.touch()
    elif target == "earlier.jsonl":
        recorded(mine)
    before = mine.read_bytes() if mine.exists() else None
    (tmp_path / "tape.jsonl").symlink_to(mine)
    with pytest.raises(InputError, match=r"tape.jsonl' is a link"):
        Recorder(tmp_path / "tape.jsonl")
    assert (mine.read_bytes() if mine.exists() else None) == before


def test_a_link_that_is_put_in_place_of_a_recording_later_is_not_followed(tmp_path: Path) -> None:
    tape, mine = tmp_path / "tape.jsonl", tmp_path / "mine"
    mine.touch()
    recorder = Recorder(tape)
    tape.unlink()
    tape.symlink_to(mine)
    with pytest.raises(InputError, match="cannot be written"):
        recorder.keep(
            Request(words={"a": 1}, pictures=()), Reply(message=None, error="none", latency_s=0)
        )
    assert mine.read_bytes() == b""


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "holds no exchange"),
        (b"hello\n", "line 1, is broken"),
        (b"[" * 100_000, "line 1, is broken"),
        (b'{"tape": 99}\n', "line 1, is broken"),
    ],
)
def test_what_is_no_recording_is_not_replayed(content: bytes, says: str, tmp_path: Path) -> None:
    path = tmp_path / "tape.jsonl"
    path.write_bytes(content)
    with pytest.raises(InputError, match=says):
        Replayer(path)


@given(data=st.data())
def test_damage_is_found_and_its_line_is_named(data: st.DataObject) -> None:
    whole = a_recording()
    at = data.draw(st.integers(0, len(whole) - 1))
    if data.draw(st.booleans()):
        flip = data.draw(st.integers(1, 255))
        damaged = whole[:at] + bytes([whole[at] ^ flip]) + whole[at + 1 :]
    else:
        damaged = whole[:at]
    lines, ended = damaged.splitlines(), whole.splitlines()
    with TemporaryDirectory() as folder:
        path = Path(folder) / "tape.jsonl"
        path.write_bytes(damaged)
        try:
            tape = Replayer(path)
        except InputError as error:
            refused = str(error)
        else:  # cut between two lines
            assert whole.startswith(damaged.rstrip())
            assert tape.model == "scripted"
            return
    changed = (n for n, (a, b) in enumerate(zip(lines, ended, strict=False), 1) if a != b)
    number = next(changed, None)
    assert "\n" not in refused
    assert f"line {number}," in refused or (number is None and "no exchange" in refused)
