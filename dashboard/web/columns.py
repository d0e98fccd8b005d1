"""One tick as a row of numbers: what the web page plots, a column each. No clock, no socket."""

import math
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
"""In the order of a row. `z.e` is field e of dof/z; `true.z.d` is the simulator's, in the paper's sign.
`z.lambda_per_s` is the lambda in force, (eps - e_dot)/e: less than the configured one with long delays and
after a limit cycle."""

_PLACES = {name: index for index, name in enumerate(COLUMNS)}
_FIELDS: dict[type[Schema], tuple[str, ...]] = {State: _STATE, Dof: _DOF, Command: _COMMAND, Loop: _LOOP}
_GET = {schema: attrgetter(*names) for schema, names in _FIELDS.items()}
_TRUE = _PLACES[TRUE_D[0]]
_LEAST_ERROR = 1e-9
"""m or rad: below, the quotient is rounding."""


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
    row[first : first + len(names)] = _GET[type(record)](record)
    for name in record.absent:
        if name in names:
            row[first + names.index(name)] = math.nan
    if (
        isinstance(record, Dof)
        and abs(record.e) > _LEAST_ERROR
        and not {"e", "e_dot", "eps"} & set(record.absent)
    ):
        row[_PLACES[f"{record.dof}.lambda_per_s"]] = (record.eps - record.e_dot) / record.e
    if isinstance(record, Loop):
        for index in range(first, first + len(names)):
            if row[index] >= NEVER_S:
                row[index] = math.nan


def fill_truth(row: list[float], disturbance: Sequence[float]) -> None:
    """Put the simulator's disturbance in: six numbers, NED force and body moment, of the other sign."""
    row[_TRUE : _TRUE + 4] = [-disturbance[index] for index in (0, 1, 2, 5)]
