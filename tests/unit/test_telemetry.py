"""The schema: stable shapes, honest names, and never a null."""

import json
import math
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from companion.records import DOFS, Ages, Condition, ControlSample, DiveTotals
from companion.telemetry import samples
from companion.telemetry import schemas as telemetry

DATA = Path(__file__).parents[1] / "data"
MakeSample = Callable[..., ControlSample]


def test_keys_name_vehicle_and_schema() -> None:
    tails = ("state", "dof/x", "dof/y", "dof/z", "dof/psi", "command", "supervisor", "loop")
    names = ("State", *("Dof",) * 4, "Command", "Supervisor", "Loop")
    assert telemetry.keys("kelp") == {
        f"holdfast/kelp/{tail}": f"application/json;holdfast.{name}.v1"
        for tail, name in zip(tails, names, strict=True)
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


OF_EVERY_TICK = {
    *("t_s", "boot_s", "absent", "x_desired_m", "y_desired_m", "depth_desired_m", "heading_desired_rad"),
    *("roll_desired_rad", "pitch_desired_rad", "altitude_desired_m", "depth_offset_m", "pending", "guidance"),
    *("path_number", "path_progress_m", "path_length_m", "path_speed_mps", "path_left_m", "path_left_s"),
    *("dead_motor", "reversed_motor", "current_north_mps", "current_east_mps", "current_doubt_mps"),
    "altitude_m",
}
"""Fields of State that are made in each tick, or NaN: never an old value."""


def test_a_field_of_the_state_is_absent_when_its_source_is_silent(make_sample: MakeSample) -> None:
    """A new field of State belongs to its source in `_STALE` of telemetry/samples.py, or to OF_EVERY_TICK."""
    sample = make_sample()
    verdict = replace(sample.verdict, conditions=Condition.LINK_LOST)
    silent = replace(sample, state=replace(sample.state, stale=(True,) * 4), verdict=verdict)
    state = samples.records(silent)[0]
    assert set(state.absent) | OF_EVERY_TICK == set(state.__struct_fields__)
    assert not set(state.absent) & OF_EVERY_TICK


def test_depth_and_time_of_a_dive_count_while_armed_and_leave_with_the_loop(make_sample: MakeSample) -> None:
    sample, dive = make_sample(), DiveTotals()
    for depth_m, armed, stale in (
        (0.4, True, False),
        (3.0, True, False),
        (9.0, False, False),
        (2.0, True, False),
        (8.0, True, True),
        (math.nan, True, False),
    ):
        state = replace(
            sample.state, eta=(0.0, 0.0, depth_m, 0.0), armed=armed, stale=(False, False, stale, False)
        )
        dive = dive.after(state, 0.02)
    assert dive == DiveTotals(3.0, 0.04)
    loop = samples.records(replace(sample, loop=replace(sample.loop, dive=dive)))[-1]
    assert isinstance(loop, telemetry.Loop)
    assert (loop.deepest_m, loop.dive_s) == (3.0, 0.04)


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


@given(eta=st.lists(st.floats(), min_size=4, max_size=4), age=st.floats(), reason=st.text())
def test_no_null_and_one_shape_whatever_comes(
    make_sample: MakeSample, eta: list[float], age: float, reason: str
) -> None:
    usual = {key: types(payload) for key, _, payload in samples.encode(make_sample(), "kelp")}
    wild = make_sample(eta=tuple(eta), voltage_v=age, ages=Ages(age, age, age, age, age))
    wild = replace(wild, verdict=replace(wild.verdict, reason=reason))
    for key, _, payload in samples.encode(wild, "kelp"):
        assert types(payload) == usual[key], "BlueOS' recorder takes the types of the first sample for all"
        telemetry.decode(key, payload)


def types(payload: bytes) -> dict[str, type]:
    return {name: type(value) for name, value in json.loads(payload).items()}


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
