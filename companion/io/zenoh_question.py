"""One question over Zenoh to a companion that runs already."""

import json

import zenoh

from companion.telemetry.session import configuration

ANSWER_S = 2.0  # on loopback it takes milliseconds


def asked(endpoint: str, key: str) -> bytes | None:
    """Return the answer under a key from whoever listens at `endpoint`; None where nobody does."""
    once = {"connect/timeout_ms": int(1e3 * ANSWER_S), "connect/exit_on_failure": True}
    try:
        with zenoh.open(configuration(endpoint, more=once)) as session:
            for reply in session.get(key, timeout=ANSWER_S):
                if reply.ok is not None:
                    return reply.ok.payload.to_bytes()
    except (zenoh.ZError, OSError, json.JSONDecodeError):
        return None
    return None
