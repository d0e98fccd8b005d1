"""The thrust of the commands that were sent, oldest first; before the first of them nothing was sent."""

import math
from typing import NamedTuple

from companion.core.four import each_of_two
from companion.records import ZERO, Vector

KEPT_S = 1.5
"""How long a command is kept: a loop that is later than this is not controlled."""

LONG_AGO_S = -1e6

SLOW_S = 0.1
"""Low-pass of the thrust that answers a disturbance: a wave is slower, a limit cycle quicker."""


class SentCommand(NamedTuple):
    """When a command was sent, its thrust in NED (N, N·m), and the impulse of all before it (N·s, N·m·s).

    `d_hat` is what of the thrust answers a disturbance that is slower than SLOW_S.
    """

    t_s: float
    tau: Vector
    impulse: Vector
    d_hat: Vector


def start() -> list[SentCommand]:
    """Return a history in which nothing was sent."""
    return [SentCommand(t_s=LONG_AGO_S, tau=ZERO, impulse=ZERO, d_hat=ZERO)]


def appended(commands: list[SentCommand], t_s: float, tau: Vector, d_hat: Vector) -> list[SentCommand]:
    """Return the history with what was sent at `t_s`, later than all before."""
    last = commands[-1]
    first = 0
    while first < len(commands) - 1 and commands[first + 1].t_s < t_s - KEPT_S:
        first += 1
    kept, dt_s = commands[first:], t_s - last.t_s
    share = 1.0 - math.exp(-dt_s / SLOW_S)
    slow = each_of_two(_nearer, last.d_hat, d_hat, share)
    kept.append(SentCommand(t_s, tau, each_of_two(_plus, last.impulse, last.tau, dt_s), slow))
    return kept


def mean_thrusts(
    commands: list[SentCommand], dof: int, from_s: float, since_s: float, step_s: float, steps: int
) -> tuple[list[float], float]:
    """Return the mean thrust of a degree of freedom up to `since_s`, and in each of `steps` from there.

    The newest command holds. Zero where no time passes. With it what of the thrust that was in force at
    `from_s` answers a slow disturbance.
    """
    means, answered = [], 0.0
    i, last = len(commands) - 1, len(commands) - 1
    before_s, previous = from_s, 0.0
    for k in range(-1, steps + 1):
        moment_s = since_s + step_s * k if k >= 0 else from_s
        while k <= 0 and i > 0 and commands[i].t_s > moment_s:
            i -= 1
        while i < last and commands[i + 1].t_s <= moment_s:
            i += 1
        command = commands[i]
        given = command.impulse[dof] + command.tau[dof] * (moment_s - command.t_s)
        if k >= 0:
            span_s = moment_s - before_s
            means.append((given - previous) / span_s if span_s > 0.0 else 0.0)
        else:
            answered = command.d_hat[dof]
        before_s, previous = moment_s, given
    return means, answered


def without_thrust(commands: list[SentCommand], tau: Vector) -> list[SentCommand]:
    """Take `tau` from the thrust of all commands: a motor that was believed to give it gave none."""
    now_s = commands[-1].t_s
    return [
        SentCommand(
            t_s=command.t_s,
            tau=each_of_two(_plus, command.tau, tau, -1.0),
            impulse=each_of_two(_plus, command.impulse, tau, now_s - command.t_s),
            d_hat=command.d_hat,
        )
        for command in commands
    ]


def _nearer(one: float, other: float, share: float) -> float:
    return one + share * (other - one)


def _plus(one: float, other: float, times: float) -> float:
    return one + times * other
