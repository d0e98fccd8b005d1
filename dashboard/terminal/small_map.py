"""A small map from above, north up, in the dots of Braille characters: `holdfast watch`."""

import math
from collections.abc import Iterable, Sequence

from rich.text import Text

Point = tuple[float, float]
"""North and east in m; NaN where nothing is known, which breaks a line."""

LEAST_M = 2.0
"""Width and height of what is seen, at least."""
FARTHEST_M = 1e6
"""What is beyond is no place of a vehicle, and is not drawn."""

_DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))  # rows of a character: left, right
_ARROWS = "↑↗→↘↓↙←↖"


def chart(
    lines: Sequence[tuple[str, Sequence[Point]]], here: Point, heading_rad: float, columns: int, rows: int
) -> tuple[Text, float]:
    """Draw lines, each with its style, the last on top, and an arrow where the vehicle is.

    Returns `rows` lines of `columns` characters, and how many m a character is wide.
    """
    known = [point for _, line in lines for point in line if _known(point)] + [here] * _known(here)
    (south, north), (west, east) = _range([n for n, _ in known]), _range([e for _, e in known])
    m_per_dot = max((east - west) / (2 * columns - 2), (north - south) / (4 * rows - 2))
    top, left = (north + south) / 2 + m_per_dot * 2 * rows, (east + west) / 2 - m_per_dot * columns
    dots: dict[tuple[int, int], int] = {}
    styles: dict[tuple[int, int], str] = {}
    for style, line in lines:
        for n, e in _stepped(line, m_per_dot):
            row, column = math.floor((top - n) / m_per_dot), math.floor((e - left) / m_per_dot)
            cell = row // 4, column // 2
            if 0 <= cell[0] < rows and 0 <= cell[1] < columns:
                dots[cell] = dots.get(cell, 0) | _DOTS[row % 4][column % 2]
                styles[cell] = style
    arrow = None
    if _known(here):
        arrow = math.floor((top - here[0]) / (4 * m_per_dot)), math.floor((here[1] - left) / (2 * m_per_dot))
    picture = Text()
    for row in range(rows):
        for column in range(columns):
            cell = row, column
            if cell == arrow:
                turn = heading_rad if math.isfinite(heading_rad) else 0.0
                picture.append(_ARROWS[round(turn / (math.pi / 4)) % 8], "bold")
            else:
                picture.append(chr(0x2800 + dots[cell]) if cell in dots else " ", styles.get(cell, ""))
        if row + 1 < rows:
            picture.append("\n")
    return picture, 2.0 * m_per_dot


def nice_length(most_m: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that is not above `most_m` (positive)."""
    power = 10.0 ** math.floor(math.log10(most_m))
    return next(step * power for step in (5.0, 2.0, 1.0) if step * power <= most_m * (1.0 + 1e-9))


def _known(point: Point) -> bool:
    return abs(point[0]) < FARTHEST_M and abs(point[1]) < FARTHEST_M


def _range(values: Sequence[float]) -> tuple[float, float]:
    low, high = min(values, default=0.0), max(values, default=0.0)
    missing = max(0.0, LEAST_M - (high - low)) / 2
    return low - missing, high + missing


def _stepped(line: Sequence[Point], step_m: float) -> Iterable[Point]:
    """Go along a line in steps of at most `step_m`."""
    previous = (math.nan, math.nan)
    for point in line:
        if _known(point):
            if _known(previous):
                count = math.ceil(math.dist(previous, point) / step_m)
                for i in range(1, count):
                    share = i / count
                    yield (
                        previous[0] + share * (point[0] - previous[0]),
                        previous[1] + share * (point[1] - previous[1]),
                    )
            yield point
        previous = point
