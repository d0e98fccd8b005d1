"""Who may do what through a Zenoh session that listens: its `access_control` and `downsampling`. No socket.

What is not listed here is denied. Processes on the same machine, by TCP on loopback, may do everything. A
laptop may subscribe and ask, but gives commands only where that is allowed. A vehicle of a fleet, at a
router, may publish and answer under its own name alone.
"""

from collections.abc import Sequence
from typing import Any

from companion.telemetry import schemas as telemetry

LAPTOP = "laptop"
TICK_HZ = 50.0
RADIO_TICKS = 10

_TELL = ["put", "delete", "declare_queryable", "liveliness_token", "reply"]
_SEE = ["declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"]
_ALL = ["holdfast/**", "holdfast/**/@adv/**", "sim/**"]
_Rule = dict[str, Any]


def access_control(*, allow_control: bool, radio: bool, vehicles: Sequence[str]) -> dict[str, Any]:
    """Return Zenoh's access control of a vehicle, or of a router for `vehicles`.

    The common name of a certificate is LAPTOP, or the vehicle's name.
    """
    laptop = [
        _rule("to", ["egress"], _TELL, _ALL),
        _rule("subscribe", ["ingress"], _SEE, _ALL),
        _rule("ask", ["ingress"], ["query"], _ALL[:2]),
    ]
    if not allow_control:  # a companion drops what asks for several commands at once: `**` is no way in
        laptop.append(_rule("command", ["ingress"], ["query"], ["holdfast/*/command/**"], "deny"))
    if radio:
        laptop.append(_rule("raw", ["egress"], ["put"], ["holdfast/*/raw"], "deny"))
    subjects = {
        "loopback": [_rule("all", ["ingress", "egress"], [*_TELL, *_SEE, "query"], ["**", "**/@adv/**"])],
        LAPTOP: laptop,
        **{name: _vehicle(name) for name in vehicles},
    }
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for rules in subjects.values() for rule in rules],
        "subjects": [
            {"id": "loopback", "link_protocols": ["tcp"]},
            *(
                {"id": name, "link_protocols": ["tls"], "cert_common_names": [name]}
                for name in (LAPTOP, *vehicles)
            ),
        ],
        "policies": [
            {"rules": [rule["id"] for rule in rules], "subjects": [name]} for name, rules in subjects.items()
        ],
    }


def downsampling(vehicles: Sequence[str]) -> dict[str, Any]:
    """Return what makes Zenoh pass one tick of RADIO_TICKS to a laptop.

    Zenoh lets a sample pass if the rule's last one is old enough, so each key needs a rule. A period half a
    tick shorter than wanted keeps the keys of a tick together when a tick comes late.
    """
    hz = round(TICK_HZ / (RADIO_TICKS - 0.5), 3)
    keys = [
        key
        for name in vehicles or ("*",)
        for key in (*(f"holdfast/{name}/{tail}" for tail in telemetry.EVERY_TICK), f"sim/{name}/truth")
    ]
    return {
        "id": "radio",
        "link_protocols": ["tls"],
        "flows": ["egress"],
        "messages": ["put"],
        "rules": [{"key_expr": key, "freq": hz} for key in keys],
    }


def _vehicle(name: str) -> list[_Rule]:
    """Return what a vehicle may do at a router: tell and answer under its name."""
    own = [f"holdfast/{name}/**", f"holdfast/{name}/**/@adv/**", f"sim/{name}/**"]
    return [
        _rule(f"{name} tells", ["ingress"], _TELL, own),
        _rule(f"{name} is asked", ["egress"], ["query", *_SEE], _ALL),
    ]


def _rule(
    name: str, flows: list[str], messages: list[str], keys: list[str], permission: str = "allow"
) -> _Rule:
    return {
        "id": name,
        "permission": permission,
        "flows": flows,
        "messages": messages,
        "key_exprs": keys,
    }
