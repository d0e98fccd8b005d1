"""What the web page gets: rows in a ring, the present for who is slow, ages that tell the truth."""

import math
import struct
from collections.abc import Callable

import msgspec
import numpy as np
import pytest
from builders import plan

from companion.records import ControlSample
from companion.telemetry import samples
from companion.telemetry import schemas as telemetry
from dashboard import heard_vehicles
from dashboard.web.app import MOST_BEHIND, News
from dashboard.web.fleet import Histories, VehicleHistory
from dashboard.web.rows import COLUMNS, Ring, empty_row
from dashboard.zenoh_client import Message

MakeSample = Callable[..., ControlSample]
MOST = 99


def test_a_ring_keeps_the_newest_rows_in_order_and_numbers_them_on() -> None:
    ring = Ring(4)
    assert ring.frame(0, MOST) is None
    for number in range(11):
        ring.append(float(number), [number, -number])
        epoch, first, t_s, rows = _unpack(ring.frame(0, MOST))
        kept = range(max(0, number - 3), number + 1)
        assert (epoch, first) == (0, kept[0])
        assert t_s.tolist() == list(kept)
        assert rows.tolist() == [[n, -n] for n in kept]
    assert _unpack(ring.frame(9, MOST))[1] == 9
    assert ring.frame(ring.end, MOST) is None
    assert _unpack(ring.frame(0, 2))[2].tolist() == [7, 8]
    ring.restart()
    assert ring.frame(0, MOST) is None
    ring.append(0.0, [1.0, 2.0])
    assert _unpack(ring.frame(0, MOST))[:2] == (1, 11)


@pytest.mark.parametrize("missed", [MOST_BEHIND, MOST_BEHIND + 1])
def test_who_falls_too_far_behind_gets_the_present(missed: int) -> None:
    vehicle = VehicleHistory("kelp")
    news = News(vehicle)
    for count in (1, missed):
        for _ in range(count):
            vehicle.ring.append(float(vehicle.ring.end), empty_row())
        rows = [struct.unpack_from("<I", frame, 16)[0] for frame in news.frames()]
    assert rows == [missed if missed <= MOST_BEHIND else 1]


def test_a_tick_becomes_one_row_of_what_it_said(make_sample: MakeSample) -> None:
    seen = Histories()
    seen.take(_messages(make_sample()), now_s=5.0)
    epoch, first, t_s, rows = _unpack(seen.vehicles["kelp"].ring.frame(0, MOST))
    assert (epoch, first, t_s.tolist()) == (0, 0, [12.0])
    row = dict(zip(COLUMNS, rows[0].tolist(), strict=True))
    for record, prefix in zip(samples.records(make_sample()), _PREFIXES, strict=True):
        for name in record.__struct_fields__:
            if prefix + name in row and prefix + name != "position_age_s":
                assert row[prefix + name] == pytest.approx(float(getattr(record, name))), prefix + name
    assert math.isnan(row["position_age_s"])  # it never came
    assert math.isnan(row["true.z.d"])
    assert row["x.saturated"] == 1.0
    dof = samples.records(make_sample())[3]
    assert isinstance(dof, telemetry.Dof)
    assert row[f"{dof.dof}.lambda_per_s"] == pytest.approx((dof.eps - dof.e_dot) / dof.e)
    assert row["psi.engaged"] == 0.0


def test_time_that_begins_anew_begins_an_epoch(make_sample: MakeSample) -> None:
    seen = Histories()
    seen.take(_messages(make_sample(t_s=1000.0)), now_s=1.0)
    seen.take(_messages(make_sample(t_s=3.0)), now_s=2.0)
    epoch, _, t_s, _ = _unpack(seen.vehicles["kelp"].ring.frame(0, MOST))
    assert (epoch, t_s.tolist()) == (1, [3.0])
    seen.take([m for m in _messages(make_sample(t_s=-9.0)) if m.key.endswith("/state")], now_s=2.0)
    assert seen.vehicles["kelp"].status(2.0)["loop"] is not None, "a part of a tick has a status too"


def test_ages_are_of_arrival_and_of_the_way(make_sample: MakeSample) -> None:
    seen = Histories()
    seen.take(_messages(make_sample(t_s=1.0)), now_s=10.0)
    vehicle = seen.vehicles["kelp"]
    assert vehicle.status(10.3)["age_s"] == pytest.approx(0.3)
    seen.take(_messages(make_sample(t_s=2.0)), now_s=19.0)
    assert vehicle.status(19.1)["age_s"] == pytest.approx(8.1)
    seen.take(_messages(make_sample(t_s=12.0)), now_s=21.0)
    assert vehicle.status(21.0)["age_s"] == pytest.approx(0.0)
    seen.take(_messages(make_sample(t_s=1.0)), now_s=31.0)
    assert vehicle.status(31.1)["age_s"] == pytest.approx(0.1), "its clock starts again"


def test_the_plan_is_kept_until_another_comes(make_sample: MakeSample) -> None:
    seen = Histories()
    seen.take(_messages(make_sample(t_s=1.0)), now_s=1.0)
    first = plan(t_s=2.0, name="eight")
    seen.take([Message("holdfast/kelp/plan", msgspec.json.encode(first))], now_s=2.0)
    vehicle = seen.vehicles["kelp"]
    kept, rows = vehicle.plan, vehicle.ring.end
    seen.take([Message("holdfast/kelp/plan", msgspec.json.encode(plan(t_s=7.0, name="eight")))], now_s=7.0)
    assert vehicle.plan is kept
    assert vehicle.ring.end == rows
    seen.take([Message("holdfast/kelp/plan", msgspec.json.encode(plan(t_s=8.0, name="")))], now_s=8.0)
    assert vehicle.plan == plan(t_s=8.0, name="")
    seen.take(_messages(make_sample(t_s=-9.0)), now_s=9.0)
    assert vehicle.plan is None


def test_the_truth_joins_the_tick_of_its_moment_with_the_papers_sign(make_sample: MakeSample) -> None:
    seen = Histories()
    seen.take(_messages(make_sample(t_s=1.0)), now_s=1.0)  # who is not heard has no truth
    for t_s in (33.9, 34.0, 34.1):
        truth = {"t_s": t_s, "disturbance": [1.0, 2.0, t_s, 0.0, 0.0, 4.0], "armed": True}
        seen.take([Message("sim/kelp/truth", msgspec.json.encode(truth))], now_s=1.0)
    seen.take(_messages(make_sample(t_s=2.0, boot_s=34.02)), now_s=1.1)
    seen.take(_messages(make_sample(t_s=3.0, boot_s=99.0)), now_s=1.2)
    rows = _unpack(seen.vehicles["kelp"].ring.frame(0, MOST))[3]
    true = rows[:, [COLUMNS.index(f"true.{dof}.d") for dof in ("x", "y", "z", "psi")]]
    assert true[1].tolist() == pytest.approx([-1.0, -2.0, -34.0, -4.0])
    assert np.isnan(true[[0, 2]]).all()


def test_there_is_an_end_to_vehicles(make_sample: MakeSample, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(heard_vehicles, "MOST_VEHICLES", 2)
    seen = Histories()
    for name in ("kelp", "wrack", "dulse"):
        seen.take(_messages(make_sample(), vehicle=name), now_s=1.0)
    assert list(seen.vehicles) == ["kelp", "wrack"]
    assert "'dulse' is one vehicle too many" in seen.trouble
    found = seen.get("")
    assert found is not None
    assert found.name == "kelp"
    assert seen.get("dulse") is None
    later_s = 2.0 + heard_vehicles.FORGET_S
    seen.take(_messages(make_sample(t_s=later_s), vehicle="wrack"), now_s=later_s)
    seen.take(_messages(make_sample(), vehicle="dulse"), now_s=later_s)
    assert list(seen.vehicles) == ["wrack", "dulse"], "kelp fell silent"


_PREFIXES = ("", "x.", "y.", "z.", "psi.", "", "", "")


def _messages(sample: ControlSample, vehicle: str = "kelp") -> list[Message]:
    return [Message(key, payload) for key, _, payload in samples.encode(sample, vehicle)]


def _unpack(
    frame: tuple[bytes, int] | None,
) -> tuple[
    int,
    float,
    "np.ndarray[tuple[int], np.dtype[np.float64]]",
    "np.ndarray[tuple[int, int], np.dtype[np.float32]]",
]:
    assert frame is not None
    data, end = frame
    kind, epoch, first, rows, columns = struct.unpack_from("<IIdII", data)
    assert kind == 1
    assert end == first + rows
    t_s = np.frombuffer(data, "<f8", rows, 24)
    numbers = np.frombuffer(data, "<f4", rows * columns, 24 + 8 * rows)
    return epoch, first, t_s, numbers.reshape(rows, columns)
