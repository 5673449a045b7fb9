"""The place of an experiment's trials: the simulated cell, the one that a file describes, or one of
a user's own."""

import hashlib
import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pliant.cell import Workcell
from pliant.conditions import Condition
from pliant.envelope import Limits
from pliant.errors import InputError
from pliant.experiment import decides, oracle
from pliant.methods.named import method
from pliant.own import make_own
from pliant.ur5e import configuration as ur5e
from pliant.vision.measure import PAPER, SIMULATED, Colours

if TYPE_CHECKING:
    from pliant.ur5e.cell import Operator

_NEEDS = ("kind", "prepare", "truth")
_OTHERS = {
    "ur5e": ("a real cell", ("hole_y", "grasp_roll")),
    "emulator": ("an emulated cell", ("hole_y", "grasp_roll", "friction")),
}
"""The cells that are not simulated, by kind: in words, and the quantities that can be set there."""


@dataclass(frozen=True, kw_only=True)
class Where:
    """The cell that a file describes, or one of a user's own as `file.py:Class`, or without either
    the simulated cell.

    Its properties raise InputError when the file or the class cannot be used.
    """

    file: Path | None = None
    own: str | None = None

    @property
    def is_simulated(self) -> bool:
        """Whether it is the simulated cell that ships, of which there can be many."""
        return self.file is None and self.own is None

    @cached_property
    def _made(self) -> Workcell | None:
        """The user's own cell, made once."""
        if self.own is None:
            return None
        made: Workcell = make_own("cell", self.own, _NEEDS, "pliant.cell.Workcell")
        return made

    @cached_property
    def configuration(self) -> ur5e.Configuration | None:
        """The content of the cell's file; None: there is none."""
        return None if self.file is None else ur5e.load(self.file)

    @property
    def kind(self) -> str:
        """The kind of cell as results name it: "sim", "ur5e", "emulator", or what a user's own cell
        calls itself."""
        if self._made is not None:
            return self._made.kind
        return "sim" if self.configuration is None else self.configuration.kind

    @property
    def limits(self) -> Limits:
        """The envelope of every motion in the cell."""
        given = self.configuration
        if given is None:
            return Limits()
        return Limits(
            low=given.workspace.low,
            high=given.workspace.high,
            speed_m_s=given.limits.speed_mm_s * 1e-3,
            contact_speed_m_s=given.limits.contact_speed_mm_s * 1e-3,
            compression_m=given.limits.compression_mm * 1e-3,
            goal_step_m=given.limits.goal_step_mm * 1e-3,
        )

    @property
    def colours(self) -> Colours:
        """The colours of peg and block in the cell's pictures. Where the file of a real cell names
        none, they are the paper's."""
        given = None if self.configuration is None else self.configuration.colours
        if given is not None:
            return Colours(peg=given.peg, block=given.block)
        return PAPER if self.kind == "ur5e" else SIMULATED

    @property
    def goals(self) -> Path | None:
        """The file of the goals that were taught in the cell; None: the shipped ones."""
        return None if self.configuration is None else self.configuration.goals

    @property
    def document(self) -> dict[str, Any]:
        """The cell's kind, and a content hash of its configuration or of the user's file."""
        if self.own is not None:
            return {"kind": self.kind, "configuration": decides.own_file_hash(self.own)}
        if self.configuration is None:
            return {"kind": self.kind, "configuration": None}
        content = self.configuration.model_dump(mode="json", exclude={"goals"})
        camera = self.configuration.camera
        if camera.source is ur5e.CameraSource.FILE:
            content["camera"]["where"] = Path(camera.where).name  # its folder decides nothing
        text = json.dumps(content, sort_keys=True)
        return {"kind": self.kind, "configuration": hashlib.sha256(text.encode()).hexdigest()}

    def check(self, level: str, condition: Condition, reasoner: str, by: str) -> None:
        """Whether trials of this kind can be had here. A person sets one place and one angle, sees
        through one camera and does not know the whole truth; an emulated cell does as much, with
        the paper's friction besides. What a user's own cell can do, it says itself.

        Raises:
            InputError: they cannot.
        """
        if self.configuration is None:
            return
        cell, known = _OTHERS[self.kind]
        foreign = [name for name in condition.quantities if name not in known]
        if foreign:
            raise InputError(
                f"condition '{condition.name}' on level {level} draws {', '.join(foreign)},"
                f" which nobody can set at {cell}: choose a condition and a level that draw only"
                f" {', '.join(known)}"
            )
        if self.kind == "emulator" and level != "L0":
            raise InputError(f"level {level}: {cell} has the holes of L0 only; leave it out")
        if len(method(by).cameras) > 1:
            raise InputError(
                f"method {by} looks with several cameras, and {cell} has one: choose another, such"
                " as planar"
            )
        if self.kind == "ur5e" and reasoner == oracle.NAME:
            raise InputError(f"the oracle plans from the whole truth, which {cell} does not tell")

    def open(self, operator: "Operator | None" = None) -> Workcell:
        """Make the workcell itself. A real one needs an operator.

        Raises:
            InputError: it cannot be used.
        """
        if self._made is not None:
            return self._made
        if self.configuration is None:
            from pliant.sim.cell import SimCell

            return SimCell()
        from pliant.ur5e.cell import UrCell

        return UrCell(self.configuration, operator)
