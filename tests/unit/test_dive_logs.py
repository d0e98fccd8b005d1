"""Logs of every kind as one record, the vehicle found in them, and what is said of bad ones."""

import json
import math
import re

import msgspec
import numpy as np
import pytest
from dive_logs import (
    MASS,
    dive,
    frames,
    steering,
    write_blueos_mcap,
    write_csv,
    write_dataflash,
    write_raw_mcap,
    write_sample_mcap,
    write_sticks,
    write_tlog,
)
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import PRESETS, load_vehicle
from companion.identify import fit, model
from companion.identify.model import DELAY, LAG, Track, parameters
from companion.identify.sample_table import NoDiveError
from companion.records import AXES, Z
from holdfast import RefusedError
from lab import commands
from lab.identify.identify_command import held
from lab.identify.readers import read
from lab.identify.telemetry import FIELDS, Telemetry

FRAME = "vectored_6dof"
MANUAL_CONTROL = 69
SHORT = dive(20.0)
WRITERS = {
    "dive.csv": write_csv,
    "dive.tlog": write_tlog,
    "raw.mcap": write_raw_mcap,
    "samples.mcap": write_sample_mcap,
    "blueos.mcap": write_blueos_mcap,
    "dive.BIN": write_dataflash,
}


@pytest.fixture(scope="module")
def long_dive():
    return dive(150.0)


def check(log):
    """Compare a log with the dive that was written."""
    behind_s = SHORT.t_s[-1] - log.t_s[-1]
    assert 0.0 <= behind_s < 0.3
    for body, axis in ((0, 0), (1, 1), (2, 2), (5, 3)):
        true = np.interp(log.t_s, SHORT.t_s, SHORT.velocity[:, axis])
        known = np.isfinite(log.velocity[:, body])
        assert known.mean() > 0.9
        assert np.abs(log.velocity[known, body] - true[known]).max() < 0.02
    assert np.nanmax(np.abs(log.depth - np.interp(log.t_s, SHORT.t_s, SHORT.place[:, 2]))) < 0.03
    rows = np.clip(np.searchsorted(SHORT.t_s, log.command_s + 1e-3) - 1, 0, None)
    sticks = log.commands[:, :4]
    demanded = SHORT.sticks[rows]
    whole = np.abs(demanded[:, [0, 1, 3]]).sum(axis=1) <= 1.0
    assert np.abs(sticks[whole] - demanded[whole]).max() < 0.01
    assert np.abs(np.unwrap(log.attitude[:, 2]) - np.interp(log.t_s, SHORT.t_s, SHORT.heading)).max() < 0.05


@pytest.mark.parametrize("name", WRITERS)
def test_each_kind_of_log_gives_the_dive_that_was_written(name, tmp_path):
    check(read(WRITERS[name](SHORT, tmp_path / name), FRAME))


def scored(log, vehicle):
    track = Track(log, FRAME)
    return model.score([track], [track.settled(parameters(vehicle))])


def notes_of(log):
    return "\n".join(log.notes)


@pytest.mark.parametrize(
    "how",
    [
        {},
        {"gain": 1.0},
        {"gain": 0.8, "throttle_gain": 0.7},
        {"override": True},
        {"override": True, "target": 0},
    ],
    ids=str,
)
def test_sticks_count_as_the_thrust_that_they_made(how, tmp_path):
    log = read(write_sticks(SHORT, tmp_path / "dive.tlog", **how), FRAME)
    check(log)
    name = "RC_CHANNELS_OVERRIDE" if "override" in how else "MANUAL_CONTROL times PilotGain"
    assert f"commands: not SERVO_OUTPUT_RAW at 2.0 Hz, but {name}" in log.notes


@pytest.mark.parametrize(
    ("how", "why"),
    [
        ({"armed": False}, "while it was not armed"),
        ({"mode": 2}, "in another mode than MANUAL and STABILIZE"),
        ({"sender": 245}, "from system 245, not MAV_GCS_SYSID"),
        ({"target": 2}, "for system 2"),
        ({"target": 0}, "for system 0"),
        ({"target": 2, "override": True}, "for system 2"),
        ({"gain": None}, "without a PilotGain"),
        ({"named": [("InputHold", 1.0)]}, "with InputHold"),
        ({"named": [("RollPitch", 1.0)]}, "with RollPitch"),
    ],
    ids=str,
)
def test_a_stick_that_did_not_act_is_no_command(how, why, tmp_path):
    log = read(write_sticks(SHORT, tmp_path / "dive.tlog", **how), FRAME)
    assert "commands: SERVO_OUTPUT_RAW at 2.0 Hz, too slow to tell delays" in notes_of(log)
    assert why in notes_of(log)


@pytest.mark.parametrize(
    ("at_s", "how", "unknown"),
    [
        (10.0, {"armed": False}, [True] * 6),
        (10.0, {"mode": 2}, [True] * 6),
        (10.0, {"mode": 0}, [False, False, False, True, True, True]),
        (10.0, {"gain": 0.25}, [False] * 6),
    ],
    ids=str,
)
def test_what_changes_in_mid_dive_counts_from_then_on(at_s, how, unknown, tmp_path):
    rows = [(k, t_s, how if t_s >= at_s else {}) for k, t_s in enumerate(SHORT.t_s.tolist())]
    path = tmp_path / "dive.tlog"
    with path.open("wb") as file:
        for k, t_s, now in rows:
            for frame in (*steering(SHORT, k, **now), *frames(SHORT, k)[:3]):
                file.write(round(1.7e15 + 1e6 * t_s).to_bytes(8) + frame)
    log = read(path, FRAME)
    later, before = log.command_s > at_s + 0.1, log.command_s < at_s - 1.0
    assert np.isfinite(log.commands[before]).all()
    assert np.isnan(log.commands[later]).all(axis=0).tolist() == unknown
    assert np.isnan(log.commands[later]).any(axis=0).tolist() == unknown
    known = later & np.isfinite(log.commands[:, 0])
    rows = np.clip(np.searchsorted(SHORT.t_s, log.command_s[known] + 1e-3) - 1, 0, None)
    expected = np.clip(SHORT.sticks[rows, 0], -how.get("gain", 1.0), how.get("gain", 1.0))
    assert np.abs(log.commands[known, 0] - expected).max(initial=0.0) < 0.01
    changes = Track(log, FRAME).changes
    assert np.isfinite(changes[:10, :, 2:]).all()
    assert np.isnan(changes[-10:, :, 3]).all() == unknown[3]


@pytest.mark.parametrize(
    ("write", "how"),
    [
        (write_dataflash, {"armed_at": 10.0}),
        (write_sample_mcap, {"armed_at": 10.0}),
        (write_sample_mcap, {"engaged_at": 10.0}),
    ],
)
def test_what_is_sent_before_the_vehicle_is_armed_or_engaged_is_no_command(write, how, tmp_path):
    log = read(write(SHORT, tmp_path / "dive", **how), FRAME)
    assert np.isnan(log.commands[log.command_s < 9.9]).all()
    assert np.isfinite(log.commands[log.command_s > 10.1]).all()


def test_another_vehicle_and_another_component_are_left_out(tmp_path):
    other, path = dive(20.0, seed=9), tmp_path / "dive.tlog"
    with path.open("wb") as file:
        for k in range(SHORT.t_s.size):
            mixed = [*frames(other, k, source=(1, 100)), *steering(SHORT, k), *frames(SHORT, k)]
            if k % 2:
                mixed += frames(other, k, source=(2, 1))
            for frame in mixed:
                file.write(round(1.7e15 + 5e4 * k).to_bytes(8) + frame)
    log = read(path, FRAME)
    check(log)
    assert (
        "vehicle: system/component 1/1, not 1/100, 2/1; motion: ATTITUDE and LOCAL_POSITION_NED" in log.notes
    )


def rows_of(path):
    """Return each message of a .tlog with its time, µs."""
    data, at, rows = path.read_bytes(), 0, []
    while at < len(data):
        end = at + 20 + data[at + 9]
        rows.append((int.from_bytes(data[at : at + 8]), data[at + 8 : end]))
        at = end
    return rows


@pytest.mark.parametrize("late_us", [0, 400, 30_000, 4_000_000])
@pytest.mark.parametrize(
    ("writer", "commands"),
    [
        (write_tlog, "SERVO_OUTPUT_RAW at 20.0 Hz"),
        (write_sticks, "not SERVO_OUTPUT_RAW at 2.0 Hz, but MANUAL_"),
    ],
)
def test_what_came_twice_counts_once(writer, commands, late_us, tmp_path):
    path = writer(SHORT, tmp_path / "dive.tlog")
    once = read(path, FRAME)
    again = [
        (t_us + late_us, frame) for t_us, frame in rows_of(path) if frame[7] != MANUAL_CONTROL or not late_us
    ]
    twice = sorted([*rows_of(path), *again], key=lambda row: row[0])
    path.write_bytes(b"".join(t_us.to_bytes(8) + frame for t_us, frame in twice))
    log = read(path, FRAME)
    assert f"commands: {commands}" in notes_of(log)
    assert notes_of(log).partition(";")[0] == notes_of(once).partition(";")[0]
    for mine, his in ((log.commands, once.commands), (log.command_s, once.command_s)):
        np.testing.assert_array_equal(mine, his)
    np.testing.assert_array_equal(log.velocity, once.velocity)


def steered(late_s):
    """Return the commands of a pilot whose sticks have sequence numbers, and came again so late, if so."""
    heard = Telemetry()
    for k in range(400):
        t_s = 0.05 * k
        fields = dict(zip(FIELDS["ATTITUDE"], (1e3 * t_s, *[0.0] * 6), strict=True))
        heard.take(t_s, (1, 1), 0, "ATTITUDE", fields.__getitem__)
        if k % 10 == 0:
            fields = {"autopilot": 3, "base_mode": 0xD1, "custom_mode": 19, "type": 12}
            heard.take(t_s, (1, 1), 0, "HEARTBEAT", fields.__getitem__)
            heard.take(t_s, (1, 1), 0, "NAMED_VALUE_FLOAT", {"name": "PilotGain", "value": 1.0}.__getitem__)
        came = [(k, t_s)] + ([] if late_s is None else [(k - round(late_s / 0.05), t_s)])
        for number, at_s in came:
            if number < 0:
                continue
            stick = {"target": 1, "x": 100 * (number // 3 % 5), "y": 0, "z": 500, "r": 0, "s": 0, "t": 0}
            heard.take(at_s, (255, 190), number % 256, "MANUAL_CONTROL", stick.__getitem__)
    return heard.collected().sticks


@pytest.mark.parametrize("late_s", [0.0, 0.05, 0.4])
def test_a_stick_that_came_twice_acts_once(late_s):
    np.testing.assert_array_equal(steered(late_s), steered(None))


def write_vehicles(path, *, boat_alone=False):
    """Write a log of a boat that says twice as much as the submarine beside it."""
    boat = mavlink.MAVLink(None, 2, 1)
    beat = bytes(
        mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_SURFACE_BOAT, 3, 0xD1, 0, 4, 3).pack(boat)
    )
    with path.open("wb") as file:
        for k in range(SHORT.t_s.size):
            told = [beat, *frames(SHORT, max(k - 9, 0), source=(2, 1)), *frames(SHORT, k, source=(2, 1))]
            if not boat_alone:
                told += [*steering(SHORT, k), *frames(SHORT, k)]
            for frame in told:
                file.write(round(1.7e15 + 5e4 * k).to_bytes(8) + frame)
    return path


def test_of_vehicles_the_submarine_counts(tmp_path):
    log = read(write_vehicles(tmp_path / "dive.tlog"), FRAME)
    assert "vehicle: system/component 1/1, not 2/1; motion" in notes_of(log)
    with pytest.raises(NoDiveError, match="holds no submarine: system 2 is of MAV_TYPE 11"):
        read(write_vehicles(tmp_path / "boat.tlog", boat_alone=True), FRAME)


@pytest.mark.parametrize("primary", [0, 1])
def test_of_the_ekf_s_cores_and_imus_those_in_use_count(primary, tmp_path):
    log = read(write_dataflash(SHORT, tmp_path / "dive.BIN", primary=primary), FRAME)
    check(log)
    assert "motion: ATT, IMU, XKF1, of the instances in use" in notes_of(log)


def test_an_ekf_that_is_not_in_use_is_not_read(tmp_path):
    path = write_dataflash(SHORT, tmp_path / "dive.BIN", parameters={"AHRS_EKF_TYPE": 2.0})
    log = read(path, FRAME)
    assert "XKF1" not in notes_of(log)
    assert np.isnan(log.velocity[:, :3]).all()


WITH_A_LIGHT = {f"SERVO{n}_FUNCTION": 32.0 + n for n in range(1, 9)} | {
    f"SERVO{n}_FUNCTION": 0.0 for n in range(9, 17)
}


@pytest.mark.parametrize(
    ("how", "says"),
    [
        (
            {"parameters": {"FRAME_CONFIG": 1.0}},
            r'FRAME_CONFIG is 1, vectored, but --vehicle has frame = "vec',
        ),
        ({"parameters": {"FRAME_CONFIG": 7.0}}, "FRAME_CONFIG is 7, another frame"),
        (
            {"parameters": {"SERVO9_FUNCTION": 40.0}},
            "SERVO9_FUNCTION is motor 8, but the log has outputs 1, 2, 3",
        ),
        ({"parameters": WITH_A_LIGHT | {"SERVO4_FUNCTION": 59.0}}, "no SERVOn_FUNCTION is motor 4 of frame"),
        (
            {"without": "RCOU"},
            "holds no RCOU, the outputs of the motors; it has ATT, RATE, IMU, XKF1, XKF4, BAT",
        ),
    ],
    ids=str,
)
def test_what_a_log_s_own_parameters_contradict_is_refused(how, says, tmp_path):
    with pytest.raises(NoDiveError, match=says):
        read(write_dataflash(SHORT, tmp_path / "dive.BIN", **how), FRAME)


def test_a_frame_that_a_telemetry_log_contradicts_is_refused(tmp_path):
    frame = mavlink.MAVLink_param_value_message(b"FRAME_CONFIG", 1.0, 9, 1, 0).pack(
        mavlink.MAVLink(None, 1, 1)
    )
    path = write_tlog(SHORT, tmp_path / "dive.tlog")
    path.write_bytes(path.read_bytes() + round(1.7e15 + 2e7).to_bytes(8) + bytes(frame))
    with pytest.raises(RefusedError, match="FRAME_CONFIG is 1, vectored"):
        commands.identify(["--from", str(path), "--vehicle", "heavy", "--out", str(tmp_path / "v.toml")])


def words(fields):
    """Write flags as mavlink-server 0.16 does."""
    flags = {1: "EKF_ATTITUDE", 2: "EKF_VELOCITY_HORIZ", 4: "EKF_VELOCITY_VERT", 8: "EKF_POS_HORIZ_REL"}
    if "flags" not in fields:
        return fields
    named = [name for bit, name in flags.items() if fields["flags"] & bit]
    return fields | {"flags": " | ".join([*named, hex(fields["flags"] & ~15)])}


@pytest.mark.parametrize(
    "write",
    [words, lambda fields: fields | ({"flags": {"bits": fields["flags"]}} if "flags" in fields else {})],
)
def test_blueos_writes_flags_as_words_or_as_bits(write, tmp_path):
    log = read(write_blueos_mcap(SHORT, tmp_path / "dive.mcap", write), FRAME)
    check(log)
    assert "could not be read" not in notes_of(log)


def test_a_message_that_cannot_be_read_is_counted_and_said(tmp_path):
    def write(fields):
        return fields | ({"flags": "EKF_SOMETHING_NEW"} if "flags" in fields else {})

    log = read(write_blueos_mcap(SHORT, tmp_path / "dive.mcap", write), FRAME)
    assert f"could not be read and left out: {SHORT.t_s.size // 20} EKF_STATUS_REPORT" in log.notes
    path = write_csv(SHORT, tmp_path / "dive.csv")
    path.write_text(path.read_text(encoding="utf-8").replace("\n0.050,", "\n0.050,x", 1), encoding="utf-8")
    assert "could not be read and left out: 1 cells of surge" in read(path, FRAME).notes


def test_the_quickest_message_ties_the_vehicle_s_clock_to_the_log_s(tmp_path):
    late = [0.667, *np.random.default_rng(2).uniform(0.0, 0.3, 396), 0.0, 0.1, 0.2]
    check(read(write_sticks(SHORT, tmp_path / "dive.tlog", late), FRAME))


def test_a_stamp_of_the_outputs_that_begins_again_is_followed(tmp_path):
    path = tmp_path / "dive.tlog"
    with path.open("wb") as file:
        for k in range(SHORT.t_s.size):
            for frame in frames(SHORT, k, boot_s=2**32 / 1e6 - 7.0):
                file.write(round(1.7e15 + 5e4 * k + 2e4 * (k % 9)).to_bytes(8) + frame)
    check(read(path, FRAME))


@pytest.mark.parametrize("name", ["bag", "dive.bag", "dive.db3", "DIVE.BAG", "dive"])
def test_a_ros_bag_is_refused_with_what_to_do_instead(name, tmp_path):
    path = tmp_path / name
    path.mkdir() if name == "bag" else path.write_bytes(b"#ROSBAG V2.0")
    with pytest.raises(RefusedError, match=r"docs/identify\.md has a script that makes a CSV"):
        commands.identify(["--from", str(path)])


@pytest.mark.parametrize("writer", [write_tlog, write_dataflash, write_csv])
def test_without_a_measured_speed_heave_and_yaw_are_left(writer, tmp_path):
    log = read(writer(SHORT, tmp_path / "dive", speeds=False), FRAME)
    assert not np.isfinite(log.velocity[:, :2]).any()
    assert "measured: vertical speed, turn rate;" in held(Track(log, FRAME))[0]
    row = scored(log, load_vehicle(PRESETS / "heavy.toml"))["1"]
    assert row["surge"] is row["sway"] is None
    assert max(value for value in (row["heave"], row["yaw"]) if value is not None) < 1.0


@pytest.fixture(scope="module")
def base():
    return load_vehicle(PRESETS / "heavy.toml")


FORCE = (6.0, -5.0, -9.0, 0.5)


def test_a_log_whose_commands_are_stamped_late_gives_the_vehicle_and_how_late_they_are(base, tmp_path):
    log = read(write_csv(dive(120.0, force=FORCE), tmp_path / "dive.csv", late_s=0.3), FRAME)
    found = fit.fit([Track(log, FRAME)], base)
    assert found.theta[:4] == pytest.approx(MASS, rel=0.05)
    assert found.theta[DELAY] == pytest.approx(-0.3, abs=0.03)
    assert found.theta[model.BIAS : model.BIAS + 4] == pytest.approx(FORCE, rel=0.05)
    file, _ = fit.vehicle(found, base)
    assert file.thrusters.delay_s == base.thrusters.delay_s
    assert file.thrusters.lag_s == pytest.approx(found.theta[LAG], rel=1e-3)


def test_a_time_that_ends_at_its_bound_is_said(base, tmp_path):
    log = read(write_csv(dive(60.0), tmp_path / "dive.csv", late_s=0.8), FRAME)
    said = "\n".join(fit.reported(fit.fit([Track(log, FRAME)], base), base))
    assert "the delay ends at its bound: the times of commands and measurements do not fit together" in said


def test_from_writes_a_file_that_test_gives_the_fitted_quality(long_dive, tmp_path, capsys):
    log, out = write_csv(long_dive, tmp_path / "dive.csv"), tmp_path / "mine.toml"
    assert commands.identify(["--from", str(log), "--out", str(out)]) == 0
    assert "surge: inertia" in capsys.readouterr().out
    assert out.with_suffix(".png").stat().st_size > 10_000
    text = out.read_text(encoding="utf-8")
    assert "measured: speed over ground, vertical speed, turn rate" in text
    assert commands.identify(["--test", str(log), "--vehicle", str(out), "--json"]) == 0
    scores = json.loads(capsys.readouterr().out)
    assert set(scores) == {str(log)}
    assert set(scores[str(log)]) == {"1", "2"}
    assert set(scores[str(log)]["2"]) == {*AXES, "windows"}
    assert all(scores[str(log)]["2"][axis] < 0.02 for axis in AXES)
    assert commands.identify(["--test", str(log), "--vehicle", "heavy"]) == 0
    assert "windows" in (printed := capsys.readouterr().out)
    assert "measured: speed over ground, vertical speed, turn rate" in printed


def test_a_roll_all_the_way_round_costs_no_more_than_its_own_windows(tmp_path, capsys):
    path = write_csv(dive(60.0), tmp_path / "dive.csv")
    head, *lines = path.read_text(encoding="utf-8").splitlines()
    rows, at = [line.split(",") for line in lines], head.split(",").index("phi_rad")
    for row in rows:
        turned = 2.0 * math.pi * min(max((float(row[0]) - 10.0) / 4.0, 0.0), 1.0)
        row[at] = f"{math.remainder(turned, 2.0 * math.pi):.4f}"
    path.write_text("\n".join([head, *map(",".join, rows)]) + "\n", encoding="utf-8")
    assert commands.identify(["--test", str(path), "--vehicle", "heavy"]) == 0
    said = capsys.readouterr().out
    assert (
        found := re.search(r"(\d+) of (\d+) windows of 1 s are left out: in \1 it rolls or pitches", said)
    )
    assert 40 < int(found[1]) < 60
    row = scored(read(path, FRAME), load_vehicle(PRESETS / "heavy.toml"))["1"]
    assert row["windows"] == int(found[2]) - int(found[1])
    assert all(row[axis] is not None for axis in AXES)


def test_what_is_not_known_is_not_written_as_if_it_were(base, tmp_path, capsys):
    one = dive(30.0)
    one.velocity += np.random.default_rng(3).normal(0.0, 0.3, one.velocity.shape)
    log, out = write_csv(one, tmp_path / "dive.csv"), tmp_path / "mine.toml"
    assert commands.identify(["--from", str(log), "--out", str(out)]) == 0
    said, text = capsys.readouterr().out, out.read_text(encoding="utf-8")
    known = re.findall(r"^\w+ = (\S+) +# sd (\S+)$", text, re.MULTILINE)
    assert known
    assert all(float(sigma) <= 0.5 * abs(float(value)) for value, sigma in known)
    before, after = (msgspec.to_builtins(file) for file in (base, load_vehicle(out)))
    unknown = re.findall(r"(\w+)\.(\w+): not known, found \S+ with an sd of \S+, more than half of it", said)
    assert ("thrusters", "lag_s") in unknown
    assert [after[section][key] for section, key in unknown] == [
        before[section][key] for section, key in unknown
    ]
    assert text.count("# not known; found") == len(unknown)


def test_of_an_axis_without_a_known_inertia_nothing_is_written(base, tmp_path):
    one = dive(30.0)
    one.velocity[:, 2] = np.random.default_rng(3).normal(0.0, 0.3, one.t_s.size)
    log = read(write_csv(one, tmp_path / "dive.csv"), FRAME)
    found = fit.fit([Track(log, FRAME)], base)
    file, _ = fit.vehicle(found, base)
    assert (file.heave, found.taken(Z)) == (base.heave, False)
    assert "heave: its inertia is not known: the base's numbers stay" in "\n".join(fit.reported(found, base))
    assert file.yaw.mass == pytest.approx(MASS[3], rel=0.05)
