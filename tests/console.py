"""An operator's console in a virtual dive."""

import json

from virtual import Dive, shared

from companion.io.command_queue import CommandQueue, ReceivedCommand
from companion.records import ENGAGE_S, ZERO
from companion.telemetry.schemas import Reply


class Console:
    """Stands before the engine of a virtual dive as the companion's process does, with an operator at it."""

    def __init__(self, dive, local=True):
        self._tap = dive.tap
        self.engine = dive.engine
        self.commands = CommandQueue(dive.engine.config)
        self._local = local
        self.given = []
        self.results = []
        dive.loop.engine = self
        self.dive = dive

    def step(self, now_s, inbox, health, requests, excitation=ZERO):
        while self.commands.prepare():
            pass
        given = self.commands.before_tick(self.engine, now_s)
        self.given.append(given)
        out, sample = self._tap.step(now_s, inbox, health, [*requests, *given.requests], excitation)
        self.results += self.commands.after_tick(self.engine, sample, now_s)
        return out, sample

    def ask(self, name, **what):
        """Give a command; return where its answers will be."""
        answers: list[Reply] = []
        self.commands.put(ReceivedCommand(name, json.dumps(what).encode(), answers.append, self._local))
        return answers

    def tell(self, name, within_s=ENGAGE_S + 1.0, **what):
        """Give a command, dive on until it is answered, and return the answer."""
        answers = self.ask(name, **what)
        for step in self.dive.loop.run(within_s):
            self.dive.step = step
            if answers:
                (reply,) = answers
                return reply
        raise AssertionError("no answer")


@shared
def at_console(*plant, local=True, waits_s=2.0, engaged=False, **arguments):
    """An operator at a vehicle that has waited for `waits_s`, and is engaged then if need be."""
    dive = Dive(*plant, engage=False, **arguments)
    dive.run(waits_s)
    console = Console(dive, local)
    if engaged:
        assert console.tell("engage").done
    return dive, console
