"""The structures a model replies in. Units stand in the field names; what is not a number, not
finite, beyond a metre or too long is refused. The bounds of a change stand in the schema, so that a
server that enforces schemas cannot write a plan beyond them; where one does not, the plan is read
and then refused, so that it can be cut down."""

from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, create_model

from pliant.formations import MOST_TURN, OWNED, RECOVERABLE, Formation
from pliant.pose import Axis
from pliant.reasoners.vlm.words import printable
from pliant.records import KnownMethod, shifts

_MOST_WORDS = 2000  # characters of an explanation
_MOST_MM = 1000.0  # beyond it no length in this task is in millimetres
_MOST_DEG = 180.0

Words = Annotated[str, Field(max_length=_MOST_WORDS), AfterValidator(printable)]
Vote = Literal["success", "failure", "not available"]
Millimetres = Annotated[float, Field(allow_inf_nan=False, ge=-_MOST_MM, le=_MOST_MM)]
Degrees = Annotated[float, Field(allow_inf_nan=False, ge=-_MOST_DEG, le=_MOST_DEG)]
F = TypeVar("F", bound=BaseModel)
Skill = Literal["fit", "align", "insertion"]
Corner = Literal["above the board", "on the board", "in the hole", "not seen"]


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


class Inquiry(Strict):
    """Whether you need a probe before you analyse the failure."""

    reason: Words = Field(
        description="What you are in doubt about, and how a probe would settle it"
    )
    probe: Literal["none", "look", "touch"] = Field(
        description="none: enough is known; look: lift the peg out and look with every camera;"
        " touch: that, and touch with the peg's low corner"
    )
    x_mm: Millimetres = Field(description="Of a touch, from the believed hole; else 0")
    y_mm: Millimetres = Field(description="Of a touch, from the believed hole; else 0")


class Analysis(Strict):
    """Your analysis of the failure."""

    bottom_left_corner: Corner = Field(description="Where the peg's bottom-left corner is")
    bottom_right_corner: Corner = Field(description="Where the peg's bottom-right corner is")
    what_happened: Words
    why: Words
    wrong_goal: Literal["fit", "align", "insertion", "none"] = Field(
        description="The goal that was wrong, which may be an earlier skill's"
    )
    how_to_recover: Words = Field(description="In words, with direction and size")
    fit_y_change_mm: Millimetres = Field(description="Change of the goal of fit along y")
    align_y_change_mm: Millimetres = Field(description="Change of the goal of align along y")
    insertion_z_change_mm: Millimetres = Field(description="Change of the goal of insertion, z")


class AbsoluteStep(Strict):
    skill: Skill
    goal_mm: Millimetres = Field(
        description="Absolute goal: along y for fit and align, along z for insertion"
    )
    retreat_first: bool = Field(description="Lift out of the hole and come down again before it")


class AbsolutePlan(Strict):
    """The skills to execute next, in order, ending with insertion; an empty list means stop."""

    steps: list[AbsoluteStep] = Field(max_length=len(Formation))


class BoundedPlan(Strict):
    """Where to resume, and how much to change each goal from there to insertion."""

    resume_from: Literal["fit", "align", "insertion", "stop"]
    retreat_first: bool = Field(description="Lift out of the hole and come down again first")


def motion_field(axis: Axis) -> str:
    return f"{axis}_motion_{axis.report_unit}"


def shift_field(axis: Axis) -> str:
    return f"{axis}_{axis.report_unit}"


def change_field(formation: Formation, axis: Axis) -> str:
    return f"{formation}_{axis}_change_{axis.report_unit}"


def shifted(method: KnownMethod) -> dict[Axis, list[Formation]]:
    """The axes that a plan may shift, each with the formations that it may be shifted of."""
    found: dict[Axis, list[Formation]] = {}
    for formation in RECOVERABLE:
        for axis in shifts(method, formation):
            found.setdefault(axis, []).append(formation)
    return found


def analysis_form(method: KnownMethod) -> type[Analysis]:
    """Analysis, with room for the method's shifts."""
    fields = {
        motion_field(axis): (_kind(axis), Field(description=f"Suggested {_shift_of(axis)}"))
        for axis in shifted(method)
    }
    return _extended(Analysis, fields)


def absolute_plan(method: KnownMethod) -> type[AbsolutePlan]:
    """AbsolutePlan, whose steps have room for the method's shifts."""
    fields = {
        shift_field(axis): (
            _kind(axis),
            Field(description=f"{_shift_of(axis).capitalize()}, of {' and '.join(of)} only"),
        )
        for axis, of in shifted(method).items()
    }
    if not fields:
        return AbsolutePlan
    step = _extended(AbsoluteStep, fields)
    return _extended(AbsolutePlan, {"steps": (list[step], Field(max_length=len(Formation)))})  # type: ignore[valid-type]


def bounded_plan(most_mm: float, method: KnownMethod) -> type[BoundedPlan]:
    """BoundedPlan with a change of each goal, which the schema bounds to whole millimetres within
    `most_mm`, and with room for the method's shifts."""
    changes: dict[str, Any] = {
        change_field(formation, axis): _whole(
            f"Change of the goal of {formation} along {axis}, whole millimetres", most_mm, _MOST_MM
        )
        for formation in RECOVERABLE
        for axis in OWNED[formation]
    }
    changes |= {
        change_field(formation, axis): _shift(formation, axis, most_mm)
        for formation in RECOVERABLE
        for axis in shifts(method, formation)
    }
    return _extended(BoundedPlan, changes)


def _extended(form: type[F], fields: dict[str, Any]) -> type[F]:
    """A form with more fields, or others, under the same name and words."""
    if not fields:
        return form
    return create_model(form.__name__, __base__=form, __doc__=form.__doc__, **fields)


def _kind(axis: Axis) -> Any:
    return Degrees if axis.is_angle else Millimetres


def _shift_of(axis: Axis) -> str:
    return f"shift from the belief {'in' if axis.is_angle else 'along'} {axis}"


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
