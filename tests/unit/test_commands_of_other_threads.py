"""Commands come from Zenoh's threads: one may come between any two bytecodes of what the tick does."""

import inspect
import json
import math
import sys
from types import FrameType
from typing import Any

import pytest

from companion.config import load_config
from companion.engine import Engine
from companion.io import command_queue
from companion.io.command_queue import CommandQueue, EngineInput, ReceivedCommand
from companion.records import Request, Setpoint
from companion.telemetry.schemas import Reply

LONG = {"path": {"lawn_mower": {"length_m": 30.0, "width_m": 30.0, "spacing_m": 0.5}}}


class Interrupted:
    """Ticks of a queue; the `at`th bytecode there is followed by a release, as if of another thread."""

    def __init__(self, engine: Engine, at: int) -> None:
        self.answers: list[Reply] = []
        self.left = at
        self._engine, self._queue = engine, CommandQueue(engine.config)
        for _ in range(3):
            self._put("follow", LONG)

    def _put(self, name: str, payload: object) -> None:
        received = ReceivedCommand(name, json.dumps(payload).encode(), self.answers.append, local=True)
        self._queue.put(received)

    def _trace(self, frame: FrameType, event: str, _: object) -> Any:
        if frame.f_code.co_filename != command_queue.__file__:
            return None
        frame.f_trace_opcodes = True
        if event == "opcode":
            self.left -= 1
            if self.left == 0:
                sys.settrace(None)
                self._put("release", {})
        return self._trace

    def tick(self) -> EngineInput:
        """Return what the engine gets, whatever comes meanwhile."""
        before, here = sys.gettrace(), inspect.currentframe()
        assert here is not None
        here.f_trace_opcodes = True  # Python 3.12 looks at this when settrace is called
        sys.settrace(self._trace)
        try:
            return self._queue.before_tick(self._engine, 1.0)
        finally:
            sys.settrace(before)


@pytest.fixture(scope="module")
def engine() -> Engine:
    return Engine(load_config(), Setpoint((math.nan,) * 4))


def test_a_release_that_comes_in_the_midst_of_a_tick_is_taken_by_the_next(engine: Engine) -> None:
    """A deque that is appended to while it is iterated raises, and the tick lost its requests."""
    for at in range(1, 10_000):
        queue = Interrupted(engine, at)
        first = queue.tick()
        if queue.left > 0:
            break
        given = [*first.requests, *queue.tick().requests, *queue.tick().requests]
        assert given == [Request.STOP]
        assert [reply.said for reply in queue.answers] == ["withdrawn: a release came after it"] * 3
    assert at > 100, "so many bytecodes there are at least"
