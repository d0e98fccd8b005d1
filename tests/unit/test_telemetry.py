"""The schema: stable shapes, honest names, and never a null."""

import json
import math
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest
from builders import RECORDING
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from companion.records import DOFS, Ages, Condition, ControlSample
from companion.telemetry import samples
from companion.telemetry import schemas as telemetry

DATA = Path(__file__).parents[1] / "data"
MakeSample = Callable[..., ControlSample]


def test_keys_name_vehicle_and_schema() -> None:
    assert telemetry.keys("kelp") == {
        "holdfast/kelp/state": "application/json;holdfast.State.v1",
        "holdfast/kelp/dof/x": "application/json;holdfast.Dof.v1",
        "holdfast/kelp/dof/y": "application/json;holdfast.Dof.v1",
        "holdfast/kelp/dof/z": "application/json;holdfast.Dof.v1",
        "holdfast/kelp/dof/psi": "application/json;holdfast.Dof.v1",
        "holdfast/kelp/command": "application/json;holdfast.Command.v1",
        "holdfast/kelp/supervisor": "application/json;holdfast.Supervisor.v1",
        "holdfast/kelp/loop": "application/json;holdfast.Loop.v1",
    }
    assert telemetry.key("kelp", "alive", "7") == "holdfast/kelp/alive/7"


@pytest.mark.parametrize("name", ["", "a/b", "*", "rov$1", "a?b", "a#b"])
def test_a_name_that_is_no_key_chunk_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="vehicle name"):
        telemetry.keys(name)


def test_what_is_encoded_is_what_is_decoded(make_sample: MakeSample) -> None:
    for (key, _, payload), record in zip(
        samples.encode(make_sample(), "kelp"), samples.records(make_sample()), strict=True
    ):
        decoded = telemetry.decode(key, payload)
        assert type(decoded) is type(record)
        assert decoded == record


def test_every_number_of_a_dof_keeps_its_name(make_sample: MakeSample) -> None:
    published = make_sample()
    for index, name in enumerate(DOFS):
        record = samples.records(published)[1 + index]
        assert isinstance(record, telemetry.Dof)
        assert record.dof == name
        assert (record.unit, record.tau_unit) == (("rad", "N·m") if name == "psi" else ("m", "N"))
        for column in (
            *("x_d", "x_d_dot", "x_d_ddot", "x", "x_dot", "e", "e_dot", "eps", "tau", "feedforward"),
            *("feedback", "d_hat", "d_observer", "weight_norm", "saturated", "adapting", "engaged"),
        ):
            assert getattr(record, column) == getattr(published.dofs, column)[index]


def test_what_is_not_finite_is_zero_and_named(make_sample: MakeSample) -> None:
    broken = make_sample(roll=float("nan"), eta=(math.nan, math.inf, 5.0, 0.5))
    state = telemetry.decode(*_of(samples.encode(broken, "kelp"), "holdfast/kelp/state"))
    assert isinstance(state, telemetry.State)
    assert state.absent == ("x_m", "y_m", "roll_rad")
    assert (state.x_m, state.y_m, state.depth_m, state.roll_rad) == (0.0, 0.0, 5.0, 0.0)


def test_what_is_stale_keeps_its_last_value_and_is_named(make_sample: MakeSample) -> None:
    silent = make_sample(stale=(True, False, True, False), voltage_v=float("nan"))
    state = telemetry.decode(*_of(samples.encode(silent, "kelp"), "holdfast/kelp/state"))
    assert isinstance(state, telemetry.State)
    assert state.absent == ("x_m", "x_rate_mps", "depth_m", "depth_rate_mps", "voltage_v")
    assert (state.x_m, state.depth_m, state.voltage_v) == (1.0, 5.0, 0.0)
    heave = telemetry.decode(*_of(samples.encode(silent, "kelp"), "holdfast/kelp/dof/z"))
    assert heave.absent == ("x", "x_dot", "e", "e_dot", "eps", "d_observer")
    lost = replace(silent, verdict=replace(silent.verdict, conditions=Condition.LINK_LOST))
    state = telemetry.decode(*_of(samples.encode(lost, "kelp"), "holdfast/kelp/state"))
    assert {"armed", "mode", "system_status", "pilot_gain"} < set(state.absent)


def test_an_age_before_the_first_signal_is_capped(make_sample: MakeSample) -> None:
    loop = telemetry.decode(*_of(samples.encode(make_sample(), "kelp"), "holdfast/kelp/loop"))
    assert isinstance(loop, telemetry.Loop)
    assert loop.position_age_s == telemetry.NEVER_S
    assert loop.absent == ()


def test_conditions_leave_by_name(make_sample: MakeSample) -> None:
    supervisor = samples.records(make_sample())[6]
    assert isinstance(supervisor, telemetry.Supervisor)
    assert supervisor.state == "ACTIVE"
    assert supervisor.conditions == ("POSITION_STALE", "ENGAGE_ASKED")


def test_numpy_scalars_are_numbers_too(make_sample: MakeSample) -> None:
    encoded = samples.encode(make_sample(voltage_v=np.float64(15.5), mode=np.int64(2)), "kelp")
    state = telemetry.decode(*_of(encoded, "holdfast/kelp/state"))
    assert isinstance(state, telemetry.State)
    assert (state.voltage_v, state.mode) == (15.5, 2)


@given(eta=st.lists(st.floats(), min_size=4, max_size=4), age=st.floats(), reason=st.text())
def test_no_null_and_one_shape_whatever_comes(
    make_sample: MakeSample, eta: list[float], age: float, reason: str
) -> None:
    usual = {key: set(json.loads(payload)) for key, _, payload in samples.encode(make_sample(), "kelp")}
    wild = make_sample(eta=tuple(eta), voltage_v=age, ages=Ages(age, age, age, age, age))
    wild = replace(wild, verdict=replace(wild.verdict, reason=reason))
    for key, _, payload in samples.encode(wild, "kelp"):
        fields = json.loads(payload)
        assert None not in fields.values()
        assert set(fields) == usual[key]
        telemetry.decode(key, payload)


def test_a_newer_field_is_no_stumbling_block(make_sample: MakeSample) -> None:
    key, _, payload = samples.encode(make_sample(), "kelp")[0]
    longer = msgspec.json.encode({**json.loads(payload), "salinity_psu": 35.0})
    assert telemetry.decode(key, longer) == telemetry.decode(key, payload)


def test_a_field_that_older_recordings_lack_has_a_default() -> None:
    recorded = json.loads((DATA / "telemetry-v1-fields.json").read_bytes())
    needed = {
        kind.__name__: {field.name for field in msgspec.structs.fields(kind) if field.required}
        for kind in vars(telemetry).values()
        if isinstance(kind, type)
        and issubclass(kind, msgspec.Struct)
        and kind.__module__ == telemetry.__name__
    }
    assert {name: needed[name] - set(had) for name, had in recorded.items() if needed[name] - set(had)} == {}


@pytest.mark.parametrize(
    ("key", "payload", "says"),
    [
        ("holdfast/kelp/soup", b"{}", "no key of holdfast"),
        ("sim/kelp/state", b"{}", "no key of holdfast"),
        ("holdfast/kelp", b"{}", "no key of holdfast"),
        ("holdfast/kelp/state", b'{"t_s": 1', "holdfast.State.v1"),
        ("holdfast/kelp/loop", b'{"t_s": null}', "holdfast.Loop.v1"),
    ],
)
def test_strange_keys_and_payloads_are_reported(key: str, payload: bytes, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        telemetry.decode(key, payload)


def _of(encoded: list[tuple[str, str, bytes]], wanted: str) -> tuple[str, bytes]:
    return next((key, payload) for key, _, payload in encoded if key == wanted)


def test_a_raw_tick_comes_back_as_it_left() -> None:
    start = telemetry.Start(
        config={"loop": {"rate_hz": 50.0}}, setpoint=(0.0, 1.0, 2.0, 3.0), arm=True, version="1"
    )
    raw = telemetry.Raw(
        tick=1,
        now_s=0.1 + 0.2,
        heard=[(2**62 + 1, b"\xfd\x00")],
        out=[b"a"],
        requests=["ENGAGE"],
        start=start,
    )
    payload = msgspec.msgpack.encode(raw)
    back = msgspec.msgpack.decode(payload, type=telemetry.Raw)
    assert (back.tick, back.now_s, list(back.heard), list(back.out)) == (
        1,
        0.1 + 0.2,
        [(2**62 + 1, b"\xfd\x00")],
        [b"a"],
    )
    assert (list(back.requests), back.start) == (["ENGAGE"], start)
    assert "in" in msgspec.msgpack.decode(payload)


def test_the_recorders_status_is_known_under_its_key() -> None:
    key, encoding = telemetry.published("kelp", "recorder")
    assert (key, encoding) == ("holdfast/kelp/recorder", "application/json;holdfast.Recorder.v1")
    assert telemetry.decode(key, msgspec.json.encode(RECORDING)) == RECORDING
