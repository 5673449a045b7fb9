"""What is shown of a trial: page, overlay, strip, video."""

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import av
import numpy as np
import pytest
from view_folders import HOSTILE, Page, ran, told

from pliant.envelope import Limits
from pliant.errors import InputError
from pliant.experiment import holdings
from pliant.experiment.plan import from_fields
from pliant.pose import Axis
from pliant.records import Aborted, End, Trial
from pliant.report import overlay, strip, timeline, video, words
from pliant.report.canvas import FAILURE, SUCCESS
from pliant.report.trial import write
from pliant.sim.cell import Trajectory
from pliant.sim.replay import Replay
from pliant.store import load_trial
from pliant.teaching import shipped
from pliant.text import visible


@pytest.fixture(scope="module")
def trial() -> Trial:
    """A trial whose Fit is judged a failure by a model that writes markup."""
    return told(HOSTILE)


@pytest.fixture(scope="module")
def folder(trial: Trial, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("trial")
    write(folder, trial, shipped(), video=False)
    return folder


def page_of(folder: Path) -> Page:
    return Page((folder / "index.html").read_text(encoding="utf-8"))


# --- the page ----------------------------------------------------------------------------------


def test_the_page_shows_what_models_wrote_as_text(folder: Path) -> None:
    page = page_of(folder)
    shown = visible(HOSTILE)
    # Name, reason and its line above, two requests, two replies, refusal, why.
    assert page.words.count(shown) == 9
    assert len(page.all("script")) == 3  # the page's own, its data and the library
    assert page.all("b") == []
    assert "\x1b" not in page.words


def test_the_page_holds_each_call_to_the_model_with_its_pictures(folder: Path) -> None:
    page = page_of(folder)
    assert len(page.all("details")) == 2 + 5 + 1  # calls, cards, words
    assert page.words.count("1,200 tokens in (800 cached), 34 out, 1.5 s, 0.0123 USD") == 2
    assert page.words.count("✗ Not used:") == 1
    sent = [p for p in page.all("img") if "that call" in str(p["alt"])]
    assert len(sent) == 2
    assert all((folder / str(p["src"])).is_file() for p in sent)


def test_of_a_long_trial_only_the_last_card_is_unfolded(tmp_path: Path, trial: Trial) -> None:
    some = trial.executions * 3
    executions = tuple(replace(e, index=n) for n, e in enumerate(some))
    whole = replace(trial, executions=executions, truths=trial.truths * 3, model=None)
    write(tmp_path, whole, shipped(), video=False)
    cards = page_of(tmp_path).all("details")
    unfolded = ["open" in card for card in cards]
    assert unfolded.count(True) == 1
    assert unfolded[-1]


def test_the_page_sets_proposed_admitted_and_commanded_side_by_side(folder: Path) -> None:
    words = page_of(folder).words
    assert "The rules planned in the model's place: no answer in time" in words
    assert "Clamped: the model's plan was cut down" in words
    fit, align = "Fit to y −40.0 mm, after a retreat", "Align to y"
    commanded = "Align to y 0.0 mm, execution 4"  # the trial went on as it was
    assert f"{fit}{fit}{fit}{commanded}" in words
    assert f"{align} 500.0 mm{align} 30.0 mmrefused–" in words


def test_the_page_draws_what_the_robot_measured_over_the_executions(
    folder: Path, trial: Trial
) -> None:
    data = page_of(folder).data
    samples = sum(len(m.trace.time_s) for e in trial.executions for m in e.outcome.motions)
    traces = data["traces"]
    assert {len(column) for column in traces.values()} == {samples}
    assert None not in traces["z"]  # between motions the arm holds, and the line goes on
    assert traces["time"] == sorted(traces["time"])
    fit = data["executions"][2]
    assert fit["owned"] == ["y"]
    assert fit["goal"]["y"] == pytest.approx(trial.executions[2].outcome.target.y * 1e3, abs=0.01)
    assert data["limits"]["compression"] == [20.0]


def test_a_trials_page_draws_the_limits_that_the_trial_had(trial: Trial) -> None:
    own = replace(Limits(), high=Limits().high.updated({Axis.Z: 0.35}), compression_m=0.012)
    drawn = timeline.data(replace(trial, limits=own), None)["limits"]
    assert drawn["z"] == [120.0, 350.0]
    assert drawn[timeline.COMPRESSION] == [12.0]


def test_the_timeline_is_as_wide_as_executions_are_long(folder: Path, trial: Trial) -> None:
    (bar,) = [e for e in page_of(folder).all("ol") if e.get("class") == "timeline"]
    assert bar["aria-label"]
    styles = [str(e["style"]) for e in page_of(folder).all("li") if "style" in e]
    shares = [[float(n) for n in re.findall(r"[\d.]+", style)] for style in styles]
    assert len(shares) == len(trial.executions)
    seconds, _, wide = (np.array(column) for column in zip(*shares, strict=True))
    assert wide / seconds == pytest.approx(wide[0] / seconds[0], rel=0.05)
    assert min(wide) >= 3


def test_the_page_says_in_its_title_what_was_run(trial: Trial, tmp_path: Path) -> None:
    given = {"name": "all-own", "hole_y_mm": [8, 12]}
    planned = from_fields({"pegs": "circle", "conditions": [given], "reasoners": trial.reasoner})
    holdings.prepare(planned, tmp_path)
    mine = replace(trial, condition="all-own")
    write(tmp_path / "trials" / "mine", mine, shipped())
    told = page_of(tmp_path / "trials" / "mine").words
    assert f"condition all-own (hole's place y 8.0 mm to 12.0 mm), seed {trial.seed}" in told
    assert f": {trial.reasoner}, {trial.method}" in told


def test_the_page_has_a_card_for_each_execution_in_order(folder: Path, trial: Trial) -> None:
    cards = [c["id"] for c in page_of(folder).all("article")]
    assert cards == [f"execution-{n + 1}" for n in range(len(trial.executions))]


def test_the_page_says_once_what_its_words_mean_and_which_way_y_goes(folder: Path) -> None:
    page = page_of(folder)
    for said in (
        "the level of difficulty: the paper's grid, with the paper's skills",
        "stands 47.9 mm to the right of that edge",
        "y to the right, z up",
        "within 1 mm and 0.5° of the goal",
        "docs/glossary.md",
    ):
        assert page.words.count(said) == 1
    (sketch,) = page.all("svg")
    assert "y to the right, z up" in str(sketch["aria-label"])


def test_the_page_tells_plan_refusal_and_truth_apart(folder: Path, trial: Trial) -> None:
    page = page_of(folder)
    assert "Fit to y −40.0 mm, after a retreat" in page.words
    assert "align: too far" in page.words
    assert page.words.count("Ground truth, not seen by the method") == len(trial.executions) + 1
    assert len(page.all("aside")) == len(trial.executions) + 1


def test_the_page_needs_no_network_and_every_picture_is_there_and_described(folder: Path) -> None:
    page = page_of(folder)
    assert not re.search(
        r"(src|href)=\"((?!data:,)\w+:|//)", (folder / "index.html").read_text(encoding="utf-8")
    )
    for picture in page.all("img"):
        assert picture["alt"]
        assert (folder / str(picture["src"])).is_file()


def test_the_page_says_which_executions_changed_nothing(trial: Trial, tmp_path: Path) -> None:
    fit = trial.executions[2]
    again = tuple(replace(fit, index=n) for n in (2, 3, 4))
    write(tmp_path, replace(trial, executions=(*trial.executions[:2], *again)), shipped())
    html = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "5, of which 2 repeated a state" in html
    assert html.count("As execution 3: nothing changed (2nd time)") == 1
    assert html.count(", as execution 3: nothing changed (3rd time). Go there.") == 1


def test_a_trial_that_failed_before_its_first_execution_has_a_page(
    trial: Trial, tmp_path: Path
) -> None:
    fault = replace(trial, executions=(), truths=(), end_reason="fault:lost", fault="no answer")
    write(tmp_path, fault, shipped(), video=False)
    assert "fault:lost: no answer" in page_of(tmp_path).words
    assert load_trial(tmp_path).end_reason == "fault:lost"


def test_an_execution_that_a_fault_ended_is_shown_apart_from_those_that_were_judged(
    trial: Trial, tmp_path: Path
) -> None:
    *before, last = trial.executions
    begun = Aborted(
        step=last.outcome.step,
        target=last.outcome.target,
        motions=last.outcome.motions,
        under_way=last.outcome.target,
    )
    fault = replace(
        trial,
        executions=tuple(before),
        truths=trial.truths[: len(before)],
        aborted=begun,
        end_reason="fault:protective_stop",
        fault="the arm has braked",
    )
    write(tmp_path, fault, shipped(), video=False)
    page, whole = page_of(tmp_path), tmp_path / "whole"
    assert [c["id"] for c in page.all("article")][-2:] == [f"execution-{len(before)}", "aborted"]
    assert f"{len(before) + 1} · {str(last.formation).capitalize()}, not finished" in page.words
    assert "fault:protective_stop: the arm has braked" in page.words
    write(whole, trial, shipped(), video=False)
    assert page.data["traces"] == page_of(whole).data["traces"]  # what the arm did is all there


@pytest.mark.parametrize("end", End)
def test_every_end_of_a_trial_has_words(trial: Trial, end: End) -> None:
    assert words.end(replace(trial, end_reason=end)) != end


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


def test_rewriting_a_trial_leaves_nothing_of_another(trial: Trial, tmp_path: Path) -> None:
    write(tmp_path, trial, shipped(), trajectory=ran()[1])
    shorter = replace(trial, executions=trial.executions[:2], truths=trial.truths[:2])
    (tmp_path / "video.mp4").write_bytes(b"of the longer one")
    write(tmp_path, shorter, shipped())
    overlays = sorted(path.name for path in (tmp_path / "overlays").iterdir())
    assert overlays == ["01-approach.jpg", "02-contact.jpg"]
    assert not (tmp_path / "video.mp4").exists()
    assert not (tmp_path / "trajectory.npz").exists()


# --- the video ---------------------------------------------------------------------------------


def test_a_replay_draws_what_the_trial_saw() -> None:
    trial, trajectory = ran()
    replay = Replay(trial.task, trajectory)
    drawn = replay.image("side", len(replay) - 1).astype(float)
    replay.cameras.close()
    seen = strip.snapshot(trial.executions[-1])
    assert np.abs(drawn - seen).mean() < 1.0


def test_the_storyboard_shows_every_moment_and_halts_at_each_verdict(trial: Trial) -> None:
    shots = video.storyboard(trial, ran()[1])
    samples = [shot.sample for shot in shots]
    assert samples == sorted(samples)
    assert set(samples) == set(range(len(ran()[1].time_s)))
    spans = video.spans(shots)
    assert len(spans) == len(trial.executions)
    assert all(span.begins < span.judged < span.ends for span in spans)
    assert all(one.ends == pytest.approx(next_.begins) for one, next_ in pairwise(spans))
    assert all(shot.execution is not None for shot in shots if shot.judged)


def test_a_video_without_a_trajectory_is_refused(trial: Trial, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no trajectory"):
        write(tmp_path, trial, shipped(), video=True)
    assert list(tmp_path.iterdir()) == []


def test_the_video_decodes_with_every_frame(trial: Trial, tmp_path: Path) -> None:
    whole = ran()[1]
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
    assert "video.mp4" in (tmp_path / "index.html").read_text(encoding="utf-8")
    assert not list(tmp_path.glob("**/.*"))
