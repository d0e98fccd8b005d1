"""Long work in small steps, which leave time for what must not wait: a tick, above all."""

from collections.abc import Generator
from typing import Generic, TypeVar

T = TypeVar("T")
Steps = Generator[int, None, T]
"""Yields after each step what it cost, 1 for about 20 µs of one core of a laptop; returns the result."""


def finish(steps: Steps[T]) -> T:
    """Take all steps at once; return the result."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            result: T = end.value
            return result


class Task(Generic[T]):
    """Work under way. What it raises comes out of `advance`."""

    result: T | None = None
    done = False

    def __init__(self, steps: Steps[T]) -> None:
        self._steps = steps

    def advance(self, cost: int) -> bool:
        """Take steps of this cost, or all that are left; return whether it is done."""
        try:
            while cost > 0 and not self.done:
                cost -= next(self._steps)
        except StopIteration as end:
            self.result, self.done = end.value, True
        return self.done
