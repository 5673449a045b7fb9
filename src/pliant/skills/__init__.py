"""The skills of the five contact formations (Sec. IV), as sets: the paper's, and one that is guided
by what it sees and feels.

To tell what each of its mechanisms is worth, the guided set can be had without some of them:
`guided-ease-dither` lacks two.
"""

from pliant.envelope import Limits
from pliant.errors import InputError, unknown
from pliant.skills.guided import Guided
from pliant.skills.hand import MECHANISMS, Manner
from pliant.skills.planar import Planar
from pliant.task import Task
from pliant.teaching import Teaching

PLANAR, GUIDED = "planar", "guided"
SETS = (PLANAR, GUIDED)


def skill_set(name: str, task: Task, teaching: Teaching, limits: Limits) -> Planar | Guided:
    """
    Raises:
        InputError: no set has that name.
    """
    kind, lacking = kind_of(name), lacks(name)
    if kind == PLANAR:
        return Planar(taught=teaching.goals, contact_speed_m_s=limits.contact_speed_m_s)
    manner = Manner(limits=limits, contact_speed_m_s=limits.contact_speed_m_s, lacks=lacking)
    return Guided(task=task, teaching=teaching, manner=manner)


def kind_of(name: str) -> str:
    """Which set that is, whatever it lacks.

    Raises:
        InputError: no set has that name.
    """
    kind = name.split("-")[0]
    if kind not in SETS:
        raise unknown("skills", name, SETS)
    if lacks(name) and kind == PLANAR:
        raise InputError(f"skills {name}: only {GUIDED} can go without a mechanism")
    return kind


def lacks(name: str) -> frozenset[str]:
    """The mechanisms that a set goes without.

    Raises:
        InputError: it has no such mechanism.
    """
    lacking = name.split("-")[1:]
    for mechanism in lacking:
        if mechanism not in MECHANISMS:
            raise unknown(f"mechanism in skills {name}", mechanism, MECHANISMS)
    return frozenset(lacking)
