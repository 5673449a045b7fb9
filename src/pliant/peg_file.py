"""The file of a peg, as a person writes it: its shape and sizes in millimetres."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter

from pliant.files import Fields
from pliant.polygon import Outline

LENGTHS_MM = (60, 200)  # of a peg, from the shortest to the longest
_LEAST_WRITTEN_MM = 0.5  # a size whose numbers are all smaller was meant in metres
WRITTEN = {
    "radius": ("diameter_mm",),
    "length": ("length_mm",),
    "outline": ("corners_mm", "size_x_mm"),
    "x": ("size_x_mm", "corners_mm", "diameter_mm"),
    "y": ("size_y_mm", "corners_mm", "diameter_mm"),
}
"""The fields of a peg file that may say what a message of `Peg` or `Task` is about."""

_Signed = Annotated[float, Field(gt=-10_000, lt=10_000)]  # [mm]
_Length = Annotated[float, Field(gt=0, lt=10_000)]  # [mm]


class PegFile(Fields):
    """The fields that every shape's peg file may have, in millimetres. Its hole is judged by
    `Hole`."""

    length_mm: Annotated[float, Field(ge=LENGTHS_MM[0], le=LENGTHS_MM[1])] = 90.0
    clearance_mm: _Signed = 2.0
    chamfer_mm: _Signed = 0.0

    @property
    def radius(self) -> float | None:
        """The radius of a round peg [m]; None: it is of another shape."""
        return None

    @property
    def outline(self) -> Outline:
        """The corners of a peg with flat sides, x and y [m]; none: it is round."""
        return ()


class Circle(PegFile):
    shape: Literal["circle"]
    diameter_mm: _Length

    @property
    def radius(self) -> float:
        return self.diameter_mm * 1e-3 / 2


class Rectangle(PegFile):
    shape: Literal["rectangle"]
    size_x_mm: _Length
    size_y_mm: _Length

    @property
    def outline(self) -> Outline:
        sx, sy = self.size_x_mm * 1e-3 / 2, self.size_y_mm * 1e-3 / 2
        return (-sx, -sy), (sx, -sy), (sx, sy), (-sx, sy)


class Polygon(PegFile):
    shape: Literal["polygon"]
    corners_mm: Annotated[tuple[tuple[_Signed, _Signed], ...], Field(min_length=3)]

    @property
    def outline(self) -> Outline:
        return tuple((x * 1e-3, y * 1e-3) for x, y in self.corners_mm)


Shape = Annotated[Circle | Rectangle | Polygon, Field(discriminator="shape")]
SHAPES: TypeAdapter[Shape] = TypeAdapter(Shape)


def metres(fields_given: Mapping[str, Any]) -> str:
    """The question whether metres were meant, where a size is far below a millimetre; else ""."""
    for name in ("length_mm", "diameter_mm", "size_x_mm", "size_y_mm", "corners_mm"):
        numbers = [abs(n) for n in _numbers(fields_given.get(name))]
        if 0 < max(numbers, default=0) < _LEAST_WRITTEN_MM:
            return f"; is {name} in metres? Write millimetres"
    return ""


def _numbers(value: Any) -> Iterator[float]:
    if isinstance(value, list):
        for item in value:
            yield from _numbers(item)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield value
