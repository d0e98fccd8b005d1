"""A dive by the rules of BlueOS's recorder: what it would keep, and whether what it inferred stays true.

Those rules (blueos-recorder, src/channel_descriptor.rs, read in November 2026): of the encoding what is
before the ';' counts, and what is behind names the schema; "application/json" must hold an object; the schema
comes from the first sample of a key alone.
"""

import json
from typing import Any

import numpy as np
from virtual import Dive, hold

from companion.records import ControlSample, Request, State
from companion.telemetry import samples
from companion.telemetry import schemas as telemetry
from companion.telemetry.commands import CommandResult
from companion.telemetry.event_log import EventLog


def inferred(value):
    """Return the JSON Schema that the recorder makes of a value."""
    if isinstance(value, dict):
        return {"type": "object", "properties": {key: inferred(inner) for key, inner in value.items()}}
    if isinstance(value, list):
        return {"type": "array", "items": inferred(value[0]) if value else {}}
    kinds = {type(None): "null", bool: "boolean", int: "integer", float: "number", str: "string"}
    return {"type": kinds[type(value)]}


def follows(value, schema):
    """Whether a later sample is what the first one promised; an empty array promises nothing."""
    if not schema:
        return True
    if inferred(value)["type"] != schema["type"] or value is None:
        return False
    if isinstance(value, dict):
        properties = schema["properties"]
        return value.keys() == properties.keys() and all(
            follows(inner, properties[key]) for key, inner in value.items()
        )
    return not isinstance(value, list) or all(follows(inner, schema["items"]) for inner in value)


def published(sample: ControlSample, log: EventLog, results=()):
    """Return (key, encoding, payload) of all that leaves in a tick."""
    key, encoding = telemetry.published("kelp", "event")
    events = [(key, encoding, telemetry.to_json(event)) for event in log.step(sample, results)]
    return samples.encode(sample, "kelp") + events


def whole_dive():
    """Boot, engage, a new depth, silence of the link, fault, cleared, engaged again, release."""
    dive = Dive("sensors.dvl=true", "waves.enabled=true", engage=False, setpoint=hold(z=1.0))
    yield from dive.run(2.0)
    dive.ask(Request.ENGAGE)
    yield from dive.run(4.0)
    dive.engine.aim(hold(z=2.0, psi=np.nan))
    yield from dive.run(3.0)
    dive.fault("link_cut", 2.0)
    yield from dive.run(4.0)
    assert dive.state is State.FAULT
    dive.ask(Request.CLEAR_FAULT)
    yield from dive.run(1.0)
    dive.ask(Request.ENGAGE)
    yield from dive.run(3.0)
    dive.ask(Request.STOP)
    yield from dive.run(1.0)


def test_it_keeps_every_sample_of_every_key_and_what_it_inferred_stays_true():
    schemas: dict[str, dict[str, Any]] = {}
    names, log = {}, EventLog()
    refused = CommandResult("engage", telemetry.Reply(done=False, said="no"))
    for index, step in enumerate(whole_dive()):
        for key, encoding, payload in published(step.sample, log, [refused] if index == 99 else []):
            mime, _, name = encoding.partition(";")
            value = json.loads(payload)
            assert mime == "application/json"
            assert isinstance(value, dict), "Foxglove takes objects only"
            schema = schemas.setdefault(key, inferred(value))
            names[key] = name
            assert follows(value, schema), f"{key} at {step.t_s} s: {payload!r} is not {schema}"
    assert set(schemas) == {*telemetry.keys("kelp"), telemetry.key("kelp", "event")}
    assert names["holdfast/kelp/dof/z"] == "holdfast.Dof.v1"
    plottable = {
        key: [field for field, kind in schema["properties"].items() if kind["type"] in ("number", "integer")]
        for key, schema in schemas.items()
    }
    assert all("t_s" in fields for fields in plottable.values())
    assert {"e", "eps", "tau", "d_hat"} <= set(plottable["holdfast/kelp/dof/z"])


def test_these_rules_would_notice():
    broken: dict[str, Any]
    promised = inferred({"a": 1.0, "b": ["x"], "c": []})
    assert follows({"a": 2.5, "b": [], "c": ["any", 1]}, promised)
    for broken in (
        {"a": 1, "b": [], "c": []},
        {"a": None, "b": [], "c": []},
        {"a": 1.0, "b": [1], "c": []},
        {"a": 1.0, "b": []},
    ):
        assert not follows(broken, promised)
