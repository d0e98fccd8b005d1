"""One tick as a row of numbers, the last rows of one vehicle, and the frames that a browser gets of them."""

import math
import struct
from array import array
from collections import deque
from collections.abc import Sequence
from operator import attrgetter

from companion.telemetry.schemas import NEVER_S, Command, Dof, Loop, Schema, State

_STATE = (
    *("x_m", "y_m", "depth_m", "heading_rad"),
    *("x_desired_m", "y_desired_m", "depth_desired_m", "heading_desired_rad"),
    *("roll_rad", "pitch_rad", "roll_desired_rad", "pitch_desired_rad", "voltage_v", "depth_offset_m"),
    *("current_north_mps", "current_east_mps", "current_doubt_mps"),
)
_DOF = (
    *("e", "e_dot", "eps", "tau", "feedforward", "feedback", "d_hat", "d_observer", "weight_norm"),
    *("saturated", "adapting", "engaged"),
)
_COMMAND = ("surge_delivered_n", "sway_delivered_n", "heave_delivered_n", "yaw_delivered_nm")
_LOOP = (
    *("lateness_ms", "compute_us", "link_age_s", "heartbeat_age_s", "depth_age_s", "attitude_age_s"),
    *("position_age_s", "telemetry_delay_s", "command_delay_s"),
)
_DOFS = ("x", "y", "z", "psi")

TRUE_D = tuple(f"true.{dof}.d" for dof in _DOFS)
LAMBDA = tuple(f"{dof}.lambda_per_s" for dof in _DOFS)
COLUMNS = (
    *_STATE,
    *(f"{dof}.{name}" for dof in _DOFS for name in _DOF),
    *_COMMAND,
    *_LOOP,
    *TRUE_D,
    *LAMBDA,
)
"""The fields of a row. `z.e` is field e of dof/z; `true.z.d` is the simulator's, in the paper's sign.
`z.lambda_per_s` is the lambda in force, (eps - e_dot)/e: less than the configured one with long delays and
after a limit cycle."""

_PLACES = {name: index for index, name in enumerate(COLUMNS)}
_FIELDS: dict[type[Schema], tuple[str, ...]] = {State: _STATE, Dof: _DOF, Command: _COMMAND, Loop: _LOOP}
_GET = {schema: attrgetter(*names) for schema, names in _FIELDS.items()}
_TRUE = _PLACES[TRUE_D[0]]
_LEAST_ERROR = 1e-9
"""m or rad: below, the quotient is rounding."""

_HEADER = struct.Struct("<IIdII")  # kind 1, epoch, number of the first row, rows, columns


def empty_row() -> list[float]:
    """Return a row of which nothing is known: NaN everywhere."""
    return [math.nan] * len(COLUMNS)


def fill(row: list[float], record: Schema) -> None:
    """Put a record's fields into their columns; what is absent, or never came, is NaN."""
    names = _FIELDS.get(type(record))
    if names is None:
        return
    prefix = f"{record.dof}." if isinstance(record, Dof) else ""
    first = _PLACES.get(prefix + names[0])
    if first is None:
        return  # a degree of freedom that we do not know
    never_s = NEVER_S if isinstance(record, Loop) else math.inf
    for place, (name, value) in enumerate(zip(names, _GET[type(record)](record), strict=True), first):
        row[place] = math.nan if name in record.absent or value >= never_s else value
    if isinstance(record, Dof) and abs(record.e) > _LEAST_ERROR:
        e, e_dot, eps = row[first : first + 3]
        row[_PLACES[f"{prefix}lambda_per_s"]] = (eps - e_dot) / e


def fill_truth(row: list[float], disturbance: Sequence[float]) -> None:
    """Put the simulator's disturbance in: six numbers, NED force and body moment, of the other sign."""
    row[_TRUE : _TRUE + 4] = [-disturbance[index] for index in (0, 1, 2, 5)]


class Ring:
    """The newest `capacity` rows, each with its time. They are numbered from 0 on for ever."""

    def __init__(self, capacity: int) -> None:
        self.end = 0
        """Number of the row that comes next."""
        self.epoch = 0
        """Counts the restarts of the time."""
        self._rows: deque[tuple[float, bytes]] = deque(maxlen=capacity)

    def append(self, t_s: float, row: Sequence[float]) -> None:
        """Add a row; the oldest gives way."""
        self._rows.append((t_s, array("f", row).tobytes()))
        self.end += 1

    def restart(self) -> None:
        """Forget all rows: another time begins."""
        self._rows.clear()
        self.epoch += 1

    def frame(self, start: int, most: int) -> tuple[bytes, int] | None:
        """Return the rows from number `start` on that are still there, at most `most`, and the next number.

        Little endian: u32 1, u32 epoch, f64 number of the first row, u32 rows, u32 columns, f64 time (s) of
        each row, f32 each row's numbers.
        """
        oldest = self.end - len(self._rows)
        start = max(start, oldest)
        end = min(start + most, self.end)
        if start >= end:
            return None
        rows = [self._rows[number - oldest] for number in range(start, end)]
        header = _HEADER.pack(1, self.epoch, float(start), len(rows), len(rows[0][1]) // 4)
        times = array("d", (t_s for t_s, _ in rows)).tobytes()
        return header + times + b"".join(row for _, row in rows), end
