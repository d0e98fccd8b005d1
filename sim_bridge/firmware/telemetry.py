"""All messages that the firmware tells, by number."""

from sim_bridge.firmware import instruments, messages
from sim_bridge.firmware.messages import Message, Snapshot

BUILDERS = messages.BUILDERS | instruments.BUILDERS


def build(message: int, snapshot: Snapshot) -> list[Message]:
    """Messages of one id, in the order they are sent; empty if there is nothing to tell."""
    builder = BUILDERS.get(message)
    built = builder(snapshot) if builder else None
    if built is None:
        return []
    return built if isinstance(built, list) else [built]
