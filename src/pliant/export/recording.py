"""One trial as a recording for Rerun's viewer: the cell in 3-D, pictures, plots and words, all on
the robot's clock. Rerun comes with the extra `rerun` and is imported only here."""

import importlib
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from pliant import files, pictures
from pliant.errors import InputError, installing
from pliant.experiment import film
from pliant.export.labels import Label, labels
from pliant.export.output import check_new, origin
from pliant.export.solids import solids
from pliant.export.source import Source, replayable
from pliant.export.track import Track, check_rate, track
from pliant.pose import Axis, Pose, describe
from pliant.records import Execution, Trial
from pliant.sim import model as m
from pliant.sim import replay
from pliant.sim.model import SPRINGS
from pliant.sim.setup import apply, place
from pliant.store import load_trial
from pliant.text import markdown

TIMELINE = "robot_time"
SUFFIX = ".rrd"
_PLOTTED = (Axis.Y, Axis.Z, Axis.ROLL)
_CAMERA = "side"
_SPRING = (217, 166, 38)


def write(source: Source, out: Path, *, fps: int) -> str:
    """Write the recording of the source's one trial at `fps` [Hz]; return its id.

    Raises:
        InputError: Rerun is not installed, the source has several trials, the trial has nothing to
            replay, or `out` exists, is not named .rrd or cannot be written.
    """
    if out.suffix != SUFFIX:
        raise InputError(f"'{out}' is not named {SUFFIX}: Rerun's viewer opens it by that ending")
    check_rate(fps)
    check_new(out)
    rr = _import("rerun")
    source.one()
    saved = replayable(source)[0]
    trial = load_trial(saved.folder)
    sampled = track(trial, replay.load(saved.folder), fps)
    with files.whole(out, "choose another file") as partial:
        recording = rr.RecordingStream("pliant", recording_id=trial.trial_id)
        recording.save(str(partial), default_blueprint=_blueprint())
        _Log(rr, recording, trial, sampled, fps).everything(source)
        recording.disconnect()
    return trial.trial_id


class _Log:
    """The log of one trial for Rerun."""

    def __init__(self, rr: Any, recording: Any, trial: Trial, sampled: Track, fps: int) -> None:
        self._rr, self._recording = rr, recording
        self._trial, self._track, self._fps = trial, sampled, fps
        self._times = [rr.TimeColumn(TIMELINE, duration=sampled.trajectory.time_s)]

    def everything(self, source: Source) -> None:
        self._recording.send_recording_name(self._trial.trial_id)
        self._document("about", f"# {markdown(self._trial.trial_id)}\n\n{origin(source)}")
        self._cell()
        self._film()
        self._plots()
        self._executions()

    def _cell(self) -> None:
        """Log the cell's bodies once, then where they are at every sample."""
        rr, sampled = self._rr, self._track
        model = m.build(self._trial.task)
        setup = sampled.trajectory.setup
        apply(model, setup)
        data = mujoco.MjData(model)
        parts = solids(model)
        self._still("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        for part in parts:
            mesh = rr.Mesh3D(
                vertex_positions=part.corners.astype(np.float32),
                triangle_indices=part.triangles,
                vertex_colors=part.colours,
            )
            self._still(f"world/{part.name}", mesh)
        positions, turns, springs = [], [], []
        for time_s, qpos in zip(sampled.trajectory.time_s, sampled.trajectory.qpos, strict=True):
            place(model, setup, float(time_s))
            data.qpos[:] = qpos
            mujoco.mj_kinematics(model, data)
            positions.append(data.xpos.copy())
            turns.append(np.roll(data.xquat, -1, axis=1))  # w last, as Rerun has it
            springs.append([_ends(data, k) for k in range(SPRINGS)])
        position, turn = np.array(positions), np.array(turns)
        for part in parts:
            where = rr.Transform3D.columns(
                translation=position[:, part.body], quaternion=turn[:, part.body]
            )
            self._columns(f"world/{part.name}", where)
        strips = rr.LineStrips3D.columns(strips=np.array(springs).reshape(-1, 2, 3))
        path = "world/springs"
        self._columns(path, strips.partition([SPRINGS] * len(sampled)))
        self._still(path, rr.LineStrips3D.from_fields(colors=[_SPRING], radii=[0.002]))

    def _film(self) -> None:
        """Log the side camera in the cell, with its film drawn again from the stored motion."""
        rr = self._rr
        first = self._trial.executions[0].outcome.looks[-1].observation.views[_CAMERA].camera
        path = f"world/camera_{_CAMERA}"
        self._still(path, rr.Transform3D(translation=first.position, mat3x3=first.rotation))
        self._still(
            path,
            rr.Pinhole(
                width=first.width,
                height=first.height,
                focal_length=first.focal_px,
                camera_xyz=rr.ViewCoordinates.RDF,
                image_plane_distance=0.3,
            ),
        )
        drawing = replay.Replay(self._trial.task, self._track.trajectory)
        with closing(drawing.cameras):
            movie = film.encoded(film.Drawn(drawing, _CAMERA), self._fps)
        video = rr.AssetVideo(contents=movie, media_type="video/mp4")
        self._still(f"{path}/film", video)
        stamps = video.read_frame_timestamps_nanos()
        frames = rr.VideoFrameReference.columns_nanos(stamps)
        self._columns(f"{path}/film", frames)

    def _plots(self) -> None:
        """Log plots of measured beside commanded: y and z [mm], roll [deg]; compression [mm]."""
        for axis in _PLOTTED:
            n = list(Axis).index(axis)
            for name, values in (("measured", self._track.pose), ("goal", self._track.command)):
                shown = np.array([axis.to_report(v) for v in values[:, n].tolist()])
                self._plot(f"plots/{axis}_{axis.report_unit}/{name}", shown)
        self._plot("plots/compression_mm/measured", self._track.compression_m * 1e3)

    def _executions(self) -> None:
        """Log at each look the picture that was judged, the verdict, and the analysis: what, why
        and how."""
        rr, truths = self._rr, {label.execution.index: label for label in labels(self._trial)}
        for execution in self._trial.executions:
            look = execution.outcome.looks[-1].observation
            self._recording.set_time(TIMELINE, duration=look.time_s)
            png = pictures.encoded(look.views[_CAMERA].image)
            self._recording.log(
                f"pictures/{_CAMERA}", rr.EncodedImage(contents=png, media_type="image/png")
            )
            for level, line in _lines(execution, truths.get(execution.index)):
                self._recording.log("log", rr.TextLog(line, level=level))
        if self._trial.fault:  # after the last look
            self._recording.log("log", rr.TextLog(_broken_off(self._trial), level="ERROR"))
        self._recording.reset_time()

    def _document(self, path: str, text: str) -> None:
        self._still(path, self._rr.TextDocument(text, media_type="text/markdown"))

    def _plot(self, path: str, values: NDArray[np.float64]) -> None:
        self._columns(path, self._rr.Scalars.columns(scalars=values))

    def _still(self, path: str, what: Any) -> None:
        self._recording.log(path, what, static=True)

    def _columns(self, path: str, columns: Any) -> None:
        self._recording.send_columns(path, indexes=self._times, columns=columns)


def _lines(execution: Execution, label: Label | None) -> Iterator[tuple[str, str]]:
    """A verdict in words, each line with its level in the log."""
    step, verdict = execution.outcome.step, execution.verdict
    judged = "success" if verdict.success else "failure"
    name = f"{execution.index + 1} {str(step).capitalize()}"
    level = "INFO" if verdict.success else "WARN"
    yield level, f"{name}: {judged} ({verdict.reason})"
    yield "DEBUG", f"   ended at {describe(_shown(execution.outcome.pose))}"
    if execution.recovery is not None:
        analysis = execution.recovery.analysis
        yield "INFO", f"   what: {analysis.what}"
        yield "INFO", f"   why: {analysis.why}"
        yield "INFO", f"   how: {analysis.how}"
    if label is not None:
        really = label.kind or "success"
        differs = "" if label.success == verdict.success else " (the verdict was wrong)"
        yield "DEBUG", f"   ground truth: {really}{differs}"


def _broken_off(trial: Trial) -> str:
    """Say which fault ended a trial, and what it ended."""
    begun = trial.aborted
    during = "" if begun is None else f" during {len(trial.executions) + 1} "
    during += "" if begun is None else f"{str(begun.step.formation).capitalize()}"
    return f"{trial.end_reason}{during}: {trial.fault}"


def _shown(pose: Pose) -> dict[Axis, float]:
    return {axis: pose[axis] for axis in _PLOTTED}


def _ends(data: mujoco.MjData, spring: int) -> list[NDArray[np.float64]]:
    return [data.site(f"spring{spring}_{end}").xpos.copy() for end in ("top", "bottom")]


def _blueprint() -> Any:
    """The layout of the viewer: the cell and the pictures above, plots and words below."""
    rrb = _import("rerun.blueprint")
    plots = [f"{axis}_{axis.report_unit}" for axis in _PLOTTED] + ["compression_mm"]
    camera = f"world/camera_{_CAMERA}"
    eye = rrb.EyeControls3D(position=(0.75, -0.65, 0.4), look_target=(-0.1, 0.0, 0.12))
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(
                rrb.Spatial3DView(origin="world", name="cell", eye_controls=eye),
                rrb.Spatial2DView(origin=camera, name="side camera"),
                rrb.Tabs(
                    rrb.Spatial2DView(origin=f"pictures/{_CAMERA}", name="judged picture"),
                    rrb.TextDocumentView(origin="about", name="about"),
                ),
            ),
            rrb.Horizontal(
                *[rrb.TimeSeriesView(origin=f"plots/{plot}", name=plot) for plot in plots]
            ),
            rrb.TextLogView(origin="log", name="log"),
            row_shares=[3, 2, 1],
        ),
        collapse_panels=True,
    )


def _import(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InputError(f"a recording needs the extra 'rerun': {installing('rerun')}") from error
