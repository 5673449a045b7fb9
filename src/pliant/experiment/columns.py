"""The columns of trials.parquet and executions.parquet: name, type, unit, meaning.

The one place that defines them: the Parquet schemas and the data dictionary come from here.
"""

from dataclasses import dataclass

import pyarrow as pa

from pliant.conditions import QUANTITIES
from pliant.pose import Axis
from pliant.records import SCHEMA
from pliant.table import Table


@dataclass(frozen=True, kw_only=True)
class Column:
    """One column of a table of results: `unit` is empty where there is none."""

    name: str
    type: pa.DataType
    meaning: str
    unit: str = ""


def schema(columns: tuple[Column, ...]) -> pa.Schema:
    """An explicit Parquet schema, with unit and meaning in each field's metadata."""
    return pa.schema(
        [
            pa.field(c.name, c.type, metadata={"unit": c.unit, "meaning": c.meaning})
            for c in columns
        ],
        metadata={"pliant_schema": str(SCHEMA)},
    )


def axis_field(axis: Axis) -> str:
    """An axis as a field's name, with its SI unit: "y_m", "roll_rad"."""
    return f"{axis}_rad" if axis.is_angle else f"{axis}_m"


_TEXT, _WHOLE, _YES_NO, _NUMBER = pa.string(), pa.int64(), pa.bool_(), pa.float64()
_AXES = [pa.field(axis_field(axis), _NUMBER) for axis in Axis]
_GOAL = pa.struct(_AXES)
_STEPS = pa.list_(
    pa.struct([pa.field("formation", _TEXT), pa.field("retreat", _YES_NO), pa.field("goal", _GOAL)])
)
_CHECKS = pa.list_(
    pa.struct(
        [
            pa.field("name", _TEXT),
            pa.field("vote", _YES_NO),
            pa.field("message", _TEXT),
            pa.field("paper", _YES_NO),
        ]
    )
)


def _column(name: str, kind: pa.DataType, meaning: str, unit: str = "") -> Column:
    return Column(name=name, type=kind, meaning=meaning, unit=unit)


def _poses(name: str, meaning: str) -> list[Column]:
    """The columns of a pose, one for each axis."""
    units = {axis: "rad" if axis.is_angle else "m" for axis in Axis}
    return [_column(f"{name}_{axis_field(a)}", _NUMBER, meaning, u) for a, u in units.items()]


TRIALS: tuple[Column, ...] = (
    _column("trial_id", _TEXT, "level-peg-condition-reasoner-seed; unique"),
    _column("cell", _TEXT, "sim, ur5e, or emulator: a simulated cell behind a UR5e's software"),
    _column("level", _TEXT, "which grid of disturbances: L0 is the paper's"),
    _column("peg", _TEXT, "the peg's name"),
    _column("method", _TEXT, "which method: planar is the paper's"),
    _column("condition", _TEXT, "the condition's name"),
    _column("reasoner", _TEXT, "who judged and planned, as it was named in the experiment"),
    _column("model", _TEXT, "the model behind the reasoner; null: none"),
    _column("seed", _WHOLE, "the seed that drew the setup: equal across pegs and reasoners"),
    _column("judged", _YES_NO, "the paper's F: the verdict on Insertion was success"),
    _column(
        "inserted",
        _YES_NO,
        "the paper's G: 10 mm deep inside the hole; null: nobody knows",
    ),
    _column("depth_m", _NUMBER, "final depth of the bottom face's centre below the board", "m"),
    _column(
        "end_reason", _TEXT, "inserted, exhausted, cap, stopped, refused, finished, `fault:KIND`"
    ),
    _column("fault", _TEXT, "what was said when a fault ended the trial; null: no fault"),
    _column(
        "diagnosis",
        _TEXT,
        "what was believed to be so in the end (`pliant.diagnosis`); null: not looked for",
    ),
    _column("diagnosis_weight", _NUMBER, "its weight among the hypotheses, 0 to 1"),
    _column("executions", _WHOLE, "commanded formation skills"),
    _column("extra_fit", _WHOLE, "executions of Fit beyond the first"),
    _column("extra_align", _WHOLE, "executions of Align beyond the first"),
    _column("extra_insertion", _WHOLE, "executions of Insertion beyond the first"),
    _column("moves", _WHOLE, "straight motions"),
    _column("simulated_s", _NUMBER, "on the robot's clock", "s"),
    _column("wall_s", _NUMBER, "on the wall clock; the only column that differs in a rerun", "s"),
    _column("failure_kind", _TEXT, "null: judged and inserted, or the truth is not known"),
    _column("decisions", _WHOLE, "verdicts and recoveries that a model was asked for"),
    _column("own", _WHOLE, "of these, the model's own, used as they came"),
    _column("clamped", _WHOLE, "of the decisions, plans cut down to what may be done"),
    _column("fallbacks", _WHOLE, "of the decisions, made by the rules in the model's place"),
    _column("tokens", _WHOLE, "sent to the model and received"),
    _column("cost_usd", _NUMBER, "of the model; null: not known or no model", "USD"),
    _column("latency_s", _NUMBER, "waited for the model; differs in a rerun with one", "s"),
    *(
        _column(f"drawn_{name}", _NUMBER, f"{q.meaning}: drawn, or nominal", q.si_unit)
        for name, q in QUANTITIES.items()
    ),
)

EXECUTIONS: tuple[Column, ...] = (
    _column("trial_id", _TEXT, "the trial's, as in trials.parquet"),
    _column("index", _WHOLE, "the execution's place in the trial, from 0"),
    _column("formation", _TEXT, "approach, contact, fit, align or insertion"),
    _column("retreat", _YES_NO, "it first left the hole: up, across, down"),
    *_poses("goal", "the pose that was asked for"),
    *_poses("end", "the measured pose at the end"),
    _column("stop", _TEXT, "reached, or compression: the limit ended it"),
    _column("peak_compression_m", _NUMBER, "of the wrist, from free hang", "m"),
    _column("checks", _CHECKS, "each check's vote (null: could not be made), message, and origin"),
    _column("verdict", _YES_NO, "judged a success"),
    _column("reason", _TEXT, "the verdict's reason"),
    _column("conflict", _TEXT, "which sources disagreed; null: none"),
    _column("by", _TEXT, "who judged"),
    _column("verdict_fallback", _TEXT, "why the rules judged in a model's place; null: not so"),
    _column("truth_inserted", _YES_NO, "10 mm deep inside the hole; null: not known"),
    _column("truth_fit", _YES_NO, "the peg's low edge is in the hole; null: not known"),
    _column("truth_depth_m", _NUMBER, "of the bottom face's centre below the board", "m"),
    _column("truth_tip_x_m", _NUMBER, "the bottom face's centre", "m"),
    _column("truth_tip_y_m", _NUMBER, "the bottom face's centre", "m"),
    _column("truth_tip_z_m", _NUMBER, "the bottom face's centre", "m"),
    _column("truth_tilt_rad", _NUMBER, "the peg's lean about x, positive toward -y", "rad"),
    _column("truth_hole_y_m", _NUMBER, "the hole's centre along y", "m"),
    _column("truth_compression_m", _NUMBER, "of the wrist, from free hang", "m"),
    _column("analysis_what", _TEXT, "what happened; null: no recovery was made"),
    _column("analysis_why", _TEXT, "why"),
    _column("analysis_how", _TEXT, "how to recover"),
    _column("analysis_motion", _GOAL, "the motion from the current goal; null: not on this axis"),
    _column("proposed", _STEPS, "the recovery's steps; empty: stop; null: no recovery was made"),
    _column("admitted", _STEPS, "the steps that may be done"),
    _column("refusals", pa.list_(_TEXT), "why the rest may not"),
    _column("recovery_by", _TEXT, "who made the recovery"),
    _column("recovery_fallback", _TEXT, "why the rules planned in a model's place; null: not so"),
    _column("clamped_from", _STEPS, "what a model proposed where its plan was cut; null: not cut"),
    _column("tokens", _WHOLE, "spent on the verdict and the recovery"),
    _column("cost_usd", _NUMBER, "of both; null: not known or no model", "USD"),
    _column("latency_s", _NUMBER, "waited for a model; differs in a rerun with a model", "s"),
)


def dictionary(columns: tuple[Column, ...]) -> str:
    """The columns as a Markdown table, for docs/data.md."""
    rows = [(f"`{c.name}`", f"`{_short(c.type)}`", c.unit or "–", c.meaning) for c in columns]
    return Table(["column", "type", "unit", "meaning"], rows).markdown()


def _short(kind: pa.DataType) -> str:
    return {_GOAL: "goal", _STEPS: "list<step>", _CHECKS: "list<check>"}.get(kind, str(kind))
