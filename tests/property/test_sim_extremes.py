"""No MAVLink message ends the simulator: each field alone at each extreme, and all of them there."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from sim_wire import MANUAL, Station, is_finite, manual, vehicle

RANGES = {f"{sign}int{bits}_t": bits for sign in ("", "u") for bits in (8, 16, 32, 64)}
FLOATS = (0.0, -1.0, 3.4e38, -3.4e38, 1e-45, math.nan, math.inf, -math.inf)


def extremes(kind):
    """Return what a field of this type may hold at most, at least, and in between."""
    if kind in ("float", "double"):
        return FLOATS
    if kind == "char":
        return b"", b"\xff" * 4, b"x"
    bits = RANGES[kind.replace("uint8_t_mavlink_version", "uint8_t")]
    low = 0 if kind.startswith("u") else -(2 ** (bits - 1))
    return 0, 1, low, low + 2**bits - 1, low + 2**bits - 2


def message(kind, values):
    """Build one with a value for each field; addressed to the vehicle, unless a value says otherwise."""
    fields = []
    for name, type_, length in zip(kind.fieldnames, kind.fieldtypes, _lengths(kind), strict=True):
        value = values.get(name, 1 if name.startswith("target") else b"" if type_ == "char" else 0)
        if type_ == "char":
            value = value * max(1, length // 4)
        fields.append([value] * length if length and type_ != "char" else value)
    return kind(*fields)


def _lengths(kind):
    return [kind.array_lengths[kind.ordered_fieldnames.index(name)] for name in kind.fieldnames]


def extreme(kind):
    """Give the kind with each field alone at each extreme, and with all of them there."""
    types = dict(zip(kind.fieldnames, kind.fieldtypes, strict=True))
    for name, type_ in types.items():
        for value in extremes(type_):
            yield message(kind, {name: value})
    for number in range(8):
        everything = {name: extremes(type_)[number % len(extremes(type_))] for name, type_ in types.items()}
        yield message(kind, everything)
        yield message(kind, {name: v for name, v in everything.items() if not name.startswith("target")})


@pytest.fixture
def station():
    """A ground station of a vehicle that has a position; a second one gets what is for others."""
    failsafes = "parameters={FS_PILOT_INPUT=0, FS_GCS_ENABLE=0}"
    rov = vehicle("initial.eta=[0,0,5,0,0,0]", failsafes, "sensors.dvl=true")
    Station(rov, link=3, system=2).run(0.1)
    station = Station(rov).arm()
    station.say(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 50, 1)).run(0.1)
    return station


def shares(things):
    """Divide them by ten, for as many processes."""
    things = sorted(things)
    return pytest.mark.parametrize("share", [things[start::10] for start in range(10)], ids=range(10))


@shares(mavlink.mavlink_map)
def test_any_kind(station, share):
    for number in share:
        for hostile in extreme(mavlink.mavlink_map[number]):
            station.say(hostile)
        station.run()
    station.run(0.1)
    assert is_finite(station.rov)


@shares(mavlink.enums["MAV_CMD"])
def test_any_command(station, share):
    for command in share:
        for kind in (mavlink.MAVLink_command_long_message, mavlink.MAVLink_command_int_message):
            for hostile in extreme(kind):
                hostile.command = command
                station.say(hostile)
            station.run()
    station.command(176, 1, MANUAL).run(0.1, manual())
    assert is_finite(station.rov)


@pytest.mark.parametrize("timestamp", [0, 1, 2**48 - 2, 2**48 - 1, 2**48, 2**63, 2**64 - 2, 2**64 - 1])
def test_any_time_of_signing(station, timestamp):
    station.say(mavlink.MAVLink_setup_signing_message(1, 1, b"k" * 32, timestamp)).run(0.05)
    wire = station.packer.signing
    wire.secret_key, wire.sign_outgoing, wire.timestamp = b"k" * 32, True, 2**48 - 1
    for _ in range(3):
        wire.timestamp = 2**48 - 1
        station.say(mavlink.MAVLink_param_request_read_message(1, 1, b"SURFACE_DEPTH", -1)).run(0.1)
    heard = []
    for _ in range(20):
        heard += [data for link, data in station.rov.step([]) if link == 0]
    assert all(data[2] & 1 for data in heard), "it signs"
    assert is_finite(station.rov)
