"""The skills of the five contact formations (Sec. IV), as sets: the paper's, and one that is guided
by what it sees and feels."""

from pliant.envelope import Limits
from pliant.errors import unknown
from pliant.skills.guided import Guided
from pliant.skills.hand import Manner
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
    if name == PLANAR:
        return Planar(taught=teaching.goals, contact_speed_m_s=limits.contact_speed_m_s)
    if name == GUIDED:
        manner = Manner(limits=limits, contact_speed_m_s=limits.contact_speed_m_s)
        return Guided(task=task, teaching=teaching, manner=manner)
    raise unknown("skills", name, SETS)
