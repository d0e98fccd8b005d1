"""A Zenoh session for one who publishes and may be alone: he listens where nobody else does."""

import json

import zenoh

from dashboard.zenoh_client import client_config


def open_session(endpoint: str) -> zenoh.Session:
    """Join `endpoint`, or listen there. Raises OSError when neither is possible."""
    try:
        return zenoh.open(client_config(endpoint))
    except zenoh.ZError:
        config = client_config(endpoint)
        config.insert_json5("mode", '"peer"')
        config.insert_json5("connect/endpoints", "[]")
        config.insert_json5("listen/endpoints", json.dumps([endpoint]))
        try:
            return zenoh.open(config)
        except zenoh.ZError as error:
            raise OSError(f"{endpoint}: nobody listens there, and we cannot either: {error}") from error
