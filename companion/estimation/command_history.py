"""The commands that were sent: what each asked of the axes, and the thrust that it gives."""

from bisect import bisect_right
from collections.abc import Sequence

from companion.control.frames import turned
from companion.records import ZERO, FrameShift, Vector

COMMANDS = 128
"""Kept: 2.5 s of them at 50 Hz."""

LONG_AGO_S = -1e6


class CommandHistory:
    """The last commands, oldest first; before the first of them nothing was sent."""

    def __init__(self) -> None:
        self.t_s = [LONG_AGO_S]
        """When each was sent, ascending."""
        self.axes = [ZERO]
        self._tau = [ZERO]
        """Thrust in NED, N and N·m."""
        self._impulse = [ZERO]
        """What all commands before gave until then, N·s and N·m·s."""

    def append(self, t_s: float, axes: Vector, tau: Vector) -> None:
        """Add what was sent at `t_s`, later than all before."""
        dt_s = t_s - self.t_s[-1]
        (i_x, i_y, i_z, i_psi), (x, y, z, psi) = self._impulse[-1], self._tau[-1]
        self._impulse.append((i_x + x * dt_s, i_y + y * dt_s, i_z + z * dt_s, i_psi + psi * dt_s))
        self._tau.append(tau)
        self.axes.append(axes)
        self.t_s.append(t_s)
        if len(self.t_s) > COMMANDS:
            del self.t_s[0], self.axes[0], self._tau[0], self._impulse[0]

    def mean_thrusts(self, dof: int, t_s: Sequence[float]) -> list[float]:
        """Return the mean thrust of a degree of freedom between each two of the ascending times.

        The newest command holds. Zero where no time passes.
        """
        times_s, tau, impulse = self.t_s, self._tau, self._impulse
        means: list[float] = []
        before_s, before = t_s[0], 0.0
        for moment_s in t_s:
            i = bisect_right(times_s, moment_s, 1) - 1
            given = impulse[i][dof] + tau[i][dof] * (moment_s - times_s[i])
            span_s = moment_s - before_s
            means.append((given - before) / span_s if span_s > 0.0 else 0.0)
            before_s, before = moment_s, given
        return means[1:]

    def lose(self, tau: Vector) -> None:
        """Take `tau` from the thrust of all commands: a motor that was believed to give it gave none."""
        now_s = self.t_s[-1]
        self._tau = [_less(one, tau, 1.0) for one in self._tau]
        both = zip(self._impulse, self.t_s, strict=True)
        self._impulse = [_less(given, tau, t_s - now_s) for given, t_s in both]

    def turn(self, shift: FrameShift) -> None:
        """Go on in a frame that has turned."""
        self._tau = _turned(shift, self._tau)
        self._impulse = _turned(shift, self._impulse)


def _turned(shift: FrameShift, vectors: list[Vector]) -> list[Vector]:
    return [turned(shift, vector) for vector in vectors]


def _less(one: Vector, tau: Vector, share: float) -> Vector:
    x, y, z, psi = tau
    return (one[0] - share * x, one[1] - share * y, one[2] - share * z, one[3] - share * psi)
