"""The structures a model replies in. Units stand in the field names; what is not a number, not
finite, beyond a metre or too long is refused. The bounds of a change stand in the schema, so that a
server that enforces schemas cannot write a plan beyond them; where one does not, the plan is read
and then refused, so that it can be cut down."""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, create_model

from pliant.formations import MOST_TURN, SHIFTED, Formation
from pliant.pose import Axis
from pliant.reasoners.vlm.words import printable

_MOST_WORDS = 2000  # characters of an explanation
_MOST_MM = 1000.0  # beyond it no length in this task is in millimetres
_MOST_DEG = 180.0

Words = Annotated[str, Field(max_length=_MOST_WORDS), AfterValidator(printable)]
Vote = Literal["success", "failure", "not available"]
Millimetres = Annotated[float, Field(allow_inf_nan=False, ge=-_MOST_MM, le=_MOST_MM)]
Degrees = Annotated[float, Field(allow_inf_nan=False, ge=-_MOST_DEG, le=_MOST_DEG)]
Skill = Literal["fit", "align", "insertion"]


class Strict(BaseModel):
    """Read as it is written: no field is added, left out or made into another kind."""

    model_config = ConfigDict(extra="forbid", strict=True)


class Judgement(Strict):
    """Your judgement of the skill that was executed."""

    pose_check: Vote = Field(description="What the pose check says of success")
    compression_check: Vote = Field(description="What the compression check says of success")
    table_i: Vote = Field(description="What Table I's message says of success")
    picture: Vote = Field(description="What you see in the picture yourself")
    conflict: Words = Field(description="Which sources disagree and why; empty if none do")
    reason: Words = Field(description="Why the skill succeeded or failed, weighing the sources")
    success: bool = Field(description="Your final decision on this skill")


class Analysis(Strict):
    """Your analysis of the failure."""

    what_happened: Words
    why: Words
    how_to_recover: Words = Field(description="In words, with direction and size")
    y_motion_mm: Millimetres = Field(description="Suggested motion from the current goal along y")
    z_motion_mm: Millimetres = Field(description="Suggested motion from the current goal along z")


class GuidedAnalysis(Analysis):
    """Your analysis of the failure."""

    x_motion_mm: Millimetres = Field(description="Suggested shift from the belief along x")
    pitch_motion_deg: Degrees = Field(description="Suggested shift from the belief in pitch")
    yaw_motion_deg: Degrees = Field(description="Suggested shift from the belief in yaw")


class AbsoluteStep(Strict):
    skill: Skill
    goal_mm: Millimetres = Field(
        description="Absolute goal: along y for fit and align, along z for insertion"
    )
    retreat_first: bool = Field(description="Lift out of the hole and come down again before it")


class AbsolutePlan(Strict):
    """The skills to execute next, in order, ending with insertion; an empty list means stop."""

    steps: list[AbsoluteStep] = Field(max_length=len(Formation))


class GuidedStep(AbsoluteStep):
    x_mm: Millimetres = Field(description="Shift from the belief along x, of fit and align only")
    pitch_deg: Degrees = Field(description="Shift from the belief in pitch, likewise")
    yaw_deg: Degrees = Field(description="Shift from the belief in yaw, likewise")


class GuidedPlan(Strict):
    """The skills to execute next, in order, ending with insertion; an empty list means stop."""

    steps: list[GuidedStep] = Field(max_length=len(Formation))


class BoundedPlan(Strict):
    """Where to resume, and how much to change each goal from there to insertion."""

    resume_from: Literal["fit", "align", "insertion", "stop"]
    retreat_first: bool = Field(description="Lift out of the hole and come down again first")
    fit_y_change_mm: int
    align_y_change_mm: int
    insertion_z_change_mm: int


def motion_field(axis: Axis) -> str:
    return f"{axis}_motion_{axis.report_unit}"


def shift_field(axis: Axis) -> str:
    return f"{axis}_{axis.report_unit}"


def change_field(formation: Formation, axis: Axis) -> str:
    return f"{formation}_{axis}_change_{axis.report_unit}"


def bounded_plan(most_mm: float, *, shifts: bool = False) -> type[BoundedPlan]:
    """BoundedPlan whose schema bounds each change to whole millimetres within `most_mm`; with
    `shifts` also those of the guided skills."""
    changes: dict[str, Any] = {
        name: _whole(f"Change of the goal of {skill}, whole millimetres", most_mm, _MOST_MM)
        for name, skill in (
            ("fit_y_change_mm", "fit along y"),
            ("align_y_change_mm", "align along y"),
            ("insertion_z_change_mm", "insertion along z"),
        )
    }
    if shifts:
        changes |= {
            change_field(formation, axis): _shift(formation, axis, most_mm)
            for formation, axes in SHIFTED.items()
            for axis in axes
        }
    return create_model("BoundedPlan", __base__=BoundedPlan, __doc__=BoundedPlan.__doc__, **changes)


def _whole(description: str, most: float, plausible: float) -> Any:
    """A field for a whole number: read within what is plausible, `most` bounds it in the schema."""
    bounds: dict[str, Any] = {"minimum": -int(most), "maximum": int(most)}
    return int, Field(
        ge=-plausible, le=plausible, description=description, json_schema_extra=bounds
    )


def _shift(formation: Formation, axis: Axis, most_mm: float) -> Any:
    if axis.is_angle:
        what = f"Shift of {formation} in {axis} from the belief, whole degrees"
        return _whole(what, axis.to_report(MOST_TURN), _MOST_DEG)
    return _whole(
        f"Shift of {formation} along {axis} from the belief, whole millimetres", most_mm, _MOST_MM
    )


def with_analysis(plan: type[BaseModel], analysis: type[Analysis] = Analysis) -> type[BaseModel]:
    """Analysis and plan as one reply."""
    return create_model(
        "AnalysisAndPlan",
        __base__=(plan, analysis),  # the fields of the last base come first
        __doc__=f"{Analysis.__doc__} Then: {plan.__doc__}",
    )
