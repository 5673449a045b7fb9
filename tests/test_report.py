"""What is shown of a trial: page, overlay, strip, video."""

import re
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import av
import numpy as np
import pytest

from pliant.experiment.one import Spec, perform
from pliant.formations import Formation, Step
from pliant.pose import Axis
from pliant.records import Admission, Exchange, Execution, FailureAnalysis, Recovery, Trial
from pliant.report import overlay, strip, video
from pliant.report.canvas import FAILURE, SUCCESS
from pliant.report.trial import write
from pliant.sim.cell import SimCell, Trajectory
from pliant.sim.replay import Replay
from pliant.store import load_trial
from pliant.task import condition, load_task
from pliant.teaching import shipped

MARKUP = "<script>alert('hi')</script> & <b>bold</b>"


@pytest.fixture(scope="module")
def ran() -> tuple[Trial, Trajectory]:
    cell = SimCell()
    spec = Spec(task=load_task("circle"), condition=condition("none"), seed=1, reasoner="none")
    return perform(spec, cell, shipped()), cell.trajectory()


@pytest.fixture(scope="module")
def trial(ran: tuple[Trial, Trajectory]) -> Trial:
    """A trial whose Fit is judged a failure by a model that writes markup."""
    executions = list(ran[0].executions)
    executions[2] = failed(executions[2])
    return replace(ran[0], executions=tuple(executions), model=MARKUP)


def failed(execution: Execution) -> Execution:
    exchange = Exchange(stage="judge", request="judge", reply=MARKUP, model="m")
    step = Step(formation=Formation.FIT, goal={Axis.Y: -0.04}, retreat=True)
    beyond = Step(formation=Formation.ALIGN, goal={Axis.Y: 0.5})
    analysis = FailureAnalysis(what=MARKUP, why="too short", how="further", motion=step.goal)
    return replace(
        execution,
        verdict=replace(execution.verdict, success=False, reason=MARKUP, exchanges=(exchange,)),
        recovery=Recovery(analysis=analysis, steps=(step, beyond), by="m"),
        admission=Admission(steps=(step,), refusals=("align: too far",)),
    )


@pytest.fixture(scope="module")
def folder(trial: Trial, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("trial")
    write(folder, trial, shipped(), video=False)
    return folder


class Page(HTMLParser):
    """The elements and the text of a page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.words = ""
        self.feed(path.read_text())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.words += data

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]


# --- the page ----------------------------------------------------------------------------------


def test_the_page_shows_what_models_wrote_as_text(folder: Path) -> None:
    page = Page(folder / "index.html")
    assert page.words.count(MARKUP) == 4  # the model's name, the reason, the reply, the analysis
    assert len(page.all("script")) == 3  # the page's own, its data and the library
    assert page.all("b") == []


def test_the_page_has_a_card_for_each_execution_in_order(folder: Path, trial: Trial) -> None:
    cards = [c["id"] for c in Page(folder / "index.html").all("article")]
    assert cards == [f"execution-{n + 1}" for n in range(len(trial.executions))]


def test_the_page_tells_plan_refusal_and_truth_apart(folder: Path, trial: Trial) -> None:
    page = Page(folder / "index.html")
    assert "Fit to y −40.0 mm, after a retreat" in page.words
    assert "align: too far" in page.words
    assert page.words.count("Ground truth, not seen by the method") == len(trial.executions) + 1
    assert len(page.all("aside")) == len(trial.executions) + 1


def test_the_page_needs_no_network_and_every_picture_is_there_and_described(folder: Path) -> None:
    page = Page(folder / "index.html")
    assert not re.search(r"(src|href)=\"((?!data:,)\w+:|//)", (folder / "index.html").read_text())
    for picture in page.all("img"):
        assert picture["alt"]
        assert (folder / str(picture["src"])).is_file()


def test_a_trial_that_failed_before_its_first_execution_has_a_page(
    trial: Trial, tmp_path: Path
) -> None:
    fault = replace(trial, executions=(), truths=(), end_reason="fault:lost", fault="no answer")
    write(tmp_path, fault, shipped(), video=False)
    assert "fault:lost: no answer" in Page(tmp_path / "index.html").words
    assert load_trial(tmp_path).end_reason == "fault:lost"


# --- pictures ----------------------------------------------------------------------------------


def test_the_overlay_marks_p_center_and_the_hole(trial: Trial) -> None:
    outcome = trial.executions[0].outcome
    scene, view = outcome.scene, outcome.looks[-1].observation.views["side"]
    assert scene.peg is not None
    drawn = overlay.draw(view, scene, trial.task)
    u, v = (round(overlay.SCALE * w) for w in scene.peg.center_px)
    assert drawn.shape == (960, 1280, 3)
    assert tuple(drawn[v, u]) == (255, 214, 10)


def test_the_overlay_says_what_could_not_be_measured(trial: Trial) -> None:
    outcome = trial.executions[0].outcome
    view = outcome.looks[-1].observation.views["side"]
    unseen = replace(outcome.scene, peg=None, hole=None, problems=("no peg: nothing is cyan",))
    seen_nothing = replace(unseen, problems=())
    words = overlay.draw(view, unseen, trial.task)
    assert not np.array_equal(words, overlay.draw(view, seen_nothing, trial.task))


def test_the_strip_is_green_for_success_and_purple_for_failure(trial: Trial) -> None:
    picture = strip.draw(trial.executions)
    tile = picture.shape[1] / len(trial.executions)
    colours = [tuple(picture[2, int(tile * (n + 0.5))]) for n in range(len(trial.executions))]
    expected = [SUCCESS if e.verdict.success else FAILURE for e in trial.executions]
    assert colours == expected
    assert FAILURE in colours


# --- the video ---------------------------------------------------------------------------------


def test_a_replay_draws_what_the_trial_saw(ran: tuple[Trial, Trajectory]) -> None:
    trial, trajectory = ran
    replay = Replay(trial.task, trajectory)
    drawn = replay.image("side", len(replay) - 1).astype(float)
    replay.cameras.close()
    seen = strip.snapshot(trial.executions[-1])
    assert np.abs(drawn - seen).mean() < 1.0


def test_the_storyboard_shows_every_moment_and_halts_at_each_verdict(
    trial: Trial, ran: tuple[Trial, Trajectory]
) -> None:
    shots = video.storyboard(trial, ran[1])
    samples = [shot.sample for shot in shots]
    assert samples == sorted(samples)
    assert set(samples) == set(range(len(ran[1].time_s)))
    spans = video.spans(shots)
    assert len(spans) == len(trial.executions)
    assert all(span.begins < span.judged < span.ends for span in spans)
    assert all(one.ends == pytest.approx(next_.begins) for one, next_ in pairwise(spans))
    assert all(shot.execution is not None for shot in shots if shot.judged)


def test_the_video_decodes_with_every_frame(
    trial: Trial, ran: tuple[Trial, Trajectory], tmp_path: Path
) -> None:
    whole = ran[1]
    short = Trajectory(time_s=whole.time_s[:5], qpos=whole.qpos[:5], setup=whole.setup)
    brief = replace(trial, executions=(), truths=())
    write(tmp_path, brief, shipped(), trajectory=short, video=True)
    with av.open(str(tmp_path / "video.mp4")) as container:
        stream = container.streams.video[0]
        assert (stream.width, stream.height) == (1280, 480 + video.CAPTION)
        assert stream.codec_context.pix_fmt == "yuv420p"
        assert stream.average_rate == video.FRAMES_PER_S
        frames = sum(1 for _ in container.decode(stream))
    assert frames == len(video.storyboard(brief, short))
    assert "video.mp4" in (tmp_path / "index.html").read_text()
    assert not list(tmp_path.glob("**/.*"))
