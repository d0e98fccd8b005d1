"""What the core knows of the configuration in force, and how it goes on with another one."""

from companion import assembly
from companion.config import Config
from companion.core import observers, tick
from companion.core.tick import Demand, Memory
from companion.estimation.observer_design import noise_of, tables_in_steps, with_noise
from companion.steps import Steps, Task

REDESIGN_COST = 16
"""Steps of `Steps` that one row of a table of Kalman gains takes."""


class Tuning:
    """The configuration in force, and the core's parameters, whose gains follow the noise that is there."""

    def __init__(self, config: Config) -> None:
        """Take the first; raise ConfigError for gains that are too fast (`assembly.refuse_fast_gains`)."""
        assembly.refuse_fast_gains(config)
        self.config = config
        self.parameters = assembly.parameters(config)
        self._noise = noise_of(config)
        """The noise for which the Kalman gains were computed."""
        self._redesign: tuple[tuple[float, float], Task[None]] | None = None

    def change(self, config: Config, delay_s: float | None, memory: Memory, last: Demand | None) -> Memory:
        """Take another configuration; return the memory that goes on with it, without a step in thrust.

        Raises ConfigError as `Engine.retune` does. `last` is what the last tick asked.
        """
        changed = assembly.changed(self.config, config)
        assembly.refuse_fast_gains(config, delay_s, self.config)
        if changed - {"supervisor"}:
            measured = self._as_measured(config)
            parameters = assembly.parameters(measured)
            memory = tick.retuned(self.parameters, parameters, memory, last)
            self.parameters, self._noise, self._redesign = parameters, noise_of(measured), None
        self.config = config
        return memory

    def follow(self, noise: tuple[float, float], memory: Memory) -> Memory:
        """Compute the Kalman gains for the noise of depth and heading, a part of them each tick."""
        if noise == self._noise:
            self._redesign = None
            return memory
        noisy = with_noise(self.config, *noise)
        if self._redesign is None or self._redesign[0] != noise:
            self._redesign = (noise, Task(_designing(self._as_measured(self.config), noisy)))
        if not self._redesign[1].advance(REDESIGN_COST):
            return memory
        designed = assembly.observers(noisy)
        self.parameters = self.parameters._replace(observers=designed)
        self._noise, self._redesign = noise, None
        return memory._replace(observed=observers.retuned(designed, memory.observed))

    def _as_measured(self, config: Config) -> Config:
        """Return a configuration with the noise of the gains, unless it changes the noise itself."""
        return with_noise(config, *self._noise) if noise_of(config) == noise_of(self.config) else config


def _designing(old: Config, config: Config) -> Steps[None]:
    """Make, in steps, the Kalman gains of the axes that differ."""
    for dof, (axis, wanted) in enumerate(zip(old.axes, config.axes, strict=True)):
        if axis != wanted:
            yield from tables_in_steps(config, assembly.model(config), dof)
