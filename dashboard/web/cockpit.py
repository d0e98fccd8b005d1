"""What Cockpit finds of Holdfast on a vehicle with BlueOS: widgets, and actions for joystick buttons.

The fields are those of `ExtrasJsonSchema` in bluerobotics/cockpit, src/libs/blueos/schemas.ts. Addresses are
whole: from 1.18 on Cockpit takes them as they are (src/libs/blueos.ts).
"""

from collections.abc import Mapping
from typing import Any

import msgspec

COMPONENT = 25
"""Holdfast's, `link.component` unless configured."""
ACTIONS = {"engage": 1, "release": 2, "hold here": 3}
"""Parameter 1 of the command by what it asks for."""


def extras(panels: Mapping[str, str], base_url: str, version: str) -> dict[str, Any]:
    """Return the file: a widget for each of `panels`, titles by name, and an action for each command."""
    return {
        "target_system": "Cockpit",
        "target_cockpit_api_version": "1.0.0",
        "widgets": [
            {
                "name": f"Holdfast: {title}",
                "iframe_url": f"{base_url}/panel/{name}",
                "iframe_icon": f"{base_url}/static/icon.svg",
                "version": version,
            }
            for name, title in panels.items()
        ],
        "actions": [_action(name, number, version) for name, number in ACTIONS.items()],
    }


def _action(name: str, number: int, version: str) -> dict[str, Any]:
    """Return an action that sends a command; Cockpit fills in the vehicle's system id."""
    message = {
        "target_system": "{{autopilotSystemId}}",
        "target_component": COMPONENT,
        "command": {"type": "MAV_CMD_USER_1"},
        "confirmation": 0,
        **{f"param{place}": 0 for place in range(1, 8)},
        "param1": number,
    }
    title = f"Holdfast: {name}"
    return {
        "id": f"holdfast-{name.replace(' ', '-')}",
        "name": title,
        "type": "mavlink-message",
        "config": {
            "name": title,
            "message_type": "COMMAND_LONG",
            "message_config": msgspec.json.encode(message).decode(),
        },
        "version": version,
    }
