"""The thrust of the commands that were sent, oldest first; before the first of them nothing was sent."""

from typing import NamedTuple

from companion.records import ZERO, Vector

KEPT_S = 1.5
"""How long a command is kept: a loop that is as late is not steered."""

LONG_AGO_S = -1e6


class SentCommand(NamedTuple):
    """When a command was sent, its thrust in NED (N, N·m), and the impulse of all before it (N·s, N·m·s)."""

    t_s: float
    tau: Vector
    impulse: Vector


def start() -> list[SentCommand]:
    """Return a history in which nothing was sent."""
    return [SentCommand(LONG_AGO_S, ZERO, ZERO)]


def appended(commands: list[SentCommand], t_s: float, tau: Vector) -> list[SentCommand]:
    """Return the history with what was sent at `t_s`, later than all before."""
    last = commands[-1]
    dt_s = t_s - last.t_s
    (i_x, i_y, i_z, i_psi), (x, y, z, psi) = last.impulse, last.tau
    impulse = (i_x + x * dt_s, i_y + y * dt_s, i_z + z * dt_s, i_psi + psi * dt_s)
    first = 0
    while first < len(commands) - 1 and commands[first + 1].t_s < t_s - KEPT_S:
        first += 1
    kept = commands[first:]
    kept.append(SentCommand(t_s, tau, impulse))
    return kept


def mean_thrusts(
    commands: list[SentCommand], dof: int, from_s: float, since_s: float, step_s: float, steps: int
) -> list[float]:
    """Return the mean thrust of a degree of freedom up to `since_s`, and in each of `steps` from there.

    The newest command holds. Zero where no time passes.
    """
    means = []
    i, last = len(commands) - 1, len(commands) - 1
    before_s, previous = from_s, 0.0
    for k in range(-1, steps + 1):
        moment_s = since_s + step_s * k if k >= 0 else from_s
        while i > 0 and commands[i].t_s > moment_s:
            i -= 1
        while i < last and commands[i + 1].t_s <= moment_s:
            i += 1
        command = commands[i]
        given = command.impulse[dof] + command.tau[dof] * (moment_s - command.t_s)
        if k >= 0:
            span_s = moment_s - before_s
            means.append((given - previous) / span_s if span_s > 0.0 else 0.0)
        before_s, previous = moment_s, given
    return means


def without(commands: list[SentCommand], tau: Vector) -> list[SentCommand]:
    """Take `tau` from the thrust of all commands: a motor that was believed to give it gave none."""
    now_s = commands[-1].t_s
    return [
        SentCommand(
            command.t_s, _less(command.tau, tau, 1.0), _less(command.impulse, tau, command.t_s - now_s)
        )
        for command in commands
    ]


def _less(impulse: Vector, tau: Vector, share: float) -> Vector:
    return (
        impulse[0] - share * tau[0],
        impulse[1] - share * tau[1],
        impulse[2] - share * tau[2],
        impulse[3] - share * tau[3],
    )
