"""The structures a model replies in. Units stand in the field names; what is not a number, not
finite, beyond a metre or too long is refused. The bounds of a change stand in the schema, so that a
server that enforces schemas cannot write a plan beyond them; where one does not, the plan is read
and then refused, so that it can be cut down."""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, create_model

from pliant.formations import Formation
from pliant.reasoners.vlm.words import printable

_MOST_WORDS = 2000  # characters of an explanation
_MOST_MM = 1000.0  # beyond it no length in this task is in millimetres

Words = Annotated[str, Field(max_length=_MOST_WORDS), AfterValidator(printable)]
Vote = Literal["success", "failure", "not available"]
Millimetres = Annotated[float, Field(allow_inf_nan=False, ge=-_MOST_MM, le=_MOST_MM)]
Skill = Literal["fit", "align", "insertion"]


class _Reply(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class Judgement(_Reply):
    """Your judgement of the skill that was executed."""

    pose_check: Vote = Field(description="What the pose check says of success")
    compression_check: Vote = Field(description="What the compression check says of success")
    table_i: Vote = Field(description="What Table I's message says of success")
    picture: Vote = Field(description="What you see in the picture yourself")
    conflict: Words = Field(description="Which sources disagree and why; empty if none do")
    reason: Words = Field(description="Why the skill succeeded or failed, weighing the sources")
    success: bool = Field(description="Your final decision on this skill")


class Analysis(_Reply):
    """Your analysis of the failure."""

    what_happened: Words
    why: Words
    how_to_recover: Words = Field(description="In words, with direction and size")
    y_motion_mm: Millimetres = Field(description="Suggested motion from the current goal along y")
    z_motion_mm: Millimetres = Field(description="Suggested motion from the current goal along z")


class AbsoluteStep(_Reply):
    skill: Skill
    goal_mm: Millimetres = Field(
        description="Absolute goal: along y for fit and align, along z for insertion"
    )
    retreat_first: bool = Field(description="Lift out of the hole and come down again before it")


class AbsolutePlan(_Reply):
    """The skills to execute next, in order, ending with insertion; an empty list means stop."""

    steps: list[AbsoluteStep] = Field(max_length=len(Formation))


class BoundedPlan(_Reply):
    """Where to resume, and how much to change each goal from there to insertion."""

    resume_from: Literal["fit", "align", "insertion", "stop"]
    retreat_first: bool = Field(description="Lift out of the hole and come down again first")
    fit_y_change_mm: int
    align_y_change_mm: int
    insertion_z_change_mm: int


def bounded_plan(most_mm: float) -> type[BoundedPlan]:
    """BoundedPlan whose schema bounds each change to whole millimetres within `most_mm`."""
    most = int(most_mm)
    changes: dict[str, Any] = {
        name: (
            int,
            Field(
                ge=-_MOST_MM,
                le=_MOST_MM,
                description=f"Change of the goal of {skill}, whole millimetres",
                json_schema_extra={"minimum": -most, "maximum": most},
            ),
        )
        for name, skill in (
            ("fit_y_change_mm", "fit along y"),
            ("align_y_change_mm", "align along y"),
            ("insertion_z_change_mm", "insertion along z"),
        )
    }
    return create_model("BoundedPlan", __base__=BoundedPlan, __doc__=BoundedPlan.__doc__, **changes)


def with_analysis(plan: type[BaseModel]) -> type[BaseModel]:
    """Analysis and plan as one reply."""
    return create_model(
        "AnalysisAndPlan",
        __base__=(plan, Analysis),  # the fields of the last base come first
        __doc__=f"{Analysis.__doc__} Then: {plan.__doc__}",
    )
