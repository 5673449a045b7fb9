"""The sights that come with pliant, for whatever method: by colour, or by shape where the colours
may be anything."""

from pliant.belief import hang_share, sag_m
from pliant.task import Task
from pliant.teaching import Teaching
from pliant.vision.learned import network
from pliant.vision.measure import Colours
from pliant.vision.sight import ByColour, ByShape, Sight


def shipped_sight(
    task: Task, teaching: Teaching, colours: Colours | None, *, calibrates: bool = True
) -> Sight:
    """A sight for one trial. By shape, it `calibrates` each camera by the hanging peg.

    Raises:
        InputError: the learned sight's file cannot be used.
    """
    if colours is not None:
        return ByColour(task, colours)
    network()
    share, sag = hang_share(teaching), sag_m(teaching)
    return ByShape(task, hang_share=share, sag_m=sag, calibrates=calibrates)
