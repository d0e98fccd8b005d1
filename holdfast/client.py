"""A vehicle for scripts: give it commands, and follow what it publishes. docs/data.md has examples.

The fields of commands and records are those of docs/telemetry.md.
"""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from functools import partial
from typing import cast

from companion.telemetry import schemas as telemetry
from companion.telemetry.glossary import ENDPOINT
from companion.telemetry.operator_commands import COMMANDS
from companion.telemetry.schemas import Reply, Schema, State
from dashboard.whom import heard
from dashboard.zenoh_client import Subscription
from holdfast import RefusedError

FOUND_S = 5.0
"""How long the vehicle is looked for."""
_POLL_S = 0.01


class Vehicle:
    """A vehicle by its name. Each command is a method: `await v.goto(depth_m=4)`, `await v.release()`."""

    def __init__(self, name: str, subscription: Subscription) -> None:
        self.name, self._subscription = name, subscription

    def __getattr__(self, command: str) -> Callable[..., Awaitable[Reply]]:
        """Return a command as a function of its fields; AttributeError for what is none."""
        if command not in COMMANDS:
            raise AttributeError(f"there is no command '{command}'. Known: {', '.join(COMMANDS)}")
        return partial(self.tell, command)

    async def tell(self, command: str, /, **fields: object) -> Reply:
        """Give a command and return the answer; raise RefusedError, in words, if it was not done."""
        reply = await asyncio.to_thread(self._subscription.tell, self.name, command, fields)
        if not reply.done:
            raise RefusedError(f"{self.name}: {command}: {reply.said}")
        return reply

    async def records(self, tail: str) -> AsyncIterator[Schema]:
        """Give each record of a key, such as "supervisor" or "dof/z", from now on. One may run at a time."""
        key = telemetry.key(self.name, tail)
        self._subscription.take()  # what came before
        while True:
            for message in self._subscription.take():
                if message.key == key:
                    yield telemetry.decode(key, message.payload)
            await asyncio.sleep(_POLL_S)

    async def states(self) -> AsyncIterator[State]:
        """Give the state, 50 times a second."""
        async for record in self.records("state"):
            yield cast(State, record)


@asynccontextmanager
async def connect(name: str = "", endpoint: str = ENDPOINT) -> AsyncIterator[Vehicle]:
    """Find a vehicle, by default the only one that is heard. Raises RefusedError where there is none."""
    with Subscription(f"holdfast/{name or '*'}/**", endpoint) as subscription:
        names = await asyncio.to_thread(heard, subscription, FOUND_S, name)
        if len(found := {name} & names if name else names) != 1:
            wanted = f"'{name}' is" if name else "one vehicle is wanted,"
            raise RefusedError(
                f"{wanted} not heard at {endpoint}; {await asyncio.to_thread(subscription.others)}"
            )
        yield Vehicle(found.pop(), subscription)
