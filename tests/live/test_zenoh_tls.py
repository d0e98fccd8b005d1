"""The files of `holdfast keys`, live on loopback: who has the certificate gets in, and gets what it may."""

import datetime
import json
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import zenoh
from waiting import until

from companion.io import certificates as keys
from companion.io.access_control import RADIO_TICKS
from companion.io.command_queue import ReceivedCommand
from companion.io.zenoh_publisher import Publisher
from companion.records import ControlSample
from companion.telemetry import schemas as telemetry
from companion.telemetry.schemas import Reply
from companion.telemetry.session import client_configuration, ticks_per_sample
from dashboard.zenoh_client import Subscription
from lab.ports import free_port

NOW = datetime.datetime.now(datetime.UTC)


class Vehicle:
    """A companion's publisher by vehicle.json5, and the commands that reached it."""

    def __init__(self, directory: Path, *, allow_control: bool, radio: bool = False) -> None:
        self.local = f"tcp/127.0.0.1:{free_port()}"
        self.file, self.laptop = keys.make(
            directory,
            ["127.0.0.1"],
            allow_control=allow_control,
            now=NOW,
            radio=radio,
            port=free_port(),
            local=self.local,
        )
        self.commands: list[str] = []
        self.publisher = Publisher("kelp", str(self.file), "file", self._take)

    def _take(self, received: ReceivedCommand) -> None:
        self.commands.append(received.name)
        received.answer(Reply(done=True, said="aye"))


@pytest.fixture
def diving(make_sample: Callable[..., ControlSample], tmp_path: Path) -> Iterator[Callable[..., Vehicle]]:
    vehicles: list[Vehicle] = []

    def start(*, allow_control: bool, radio: bool = False) -> Vehicle:
        vehicle = Vehicle(tmp_path / "keys", allow_control=allow_control, radio=radio)
        vehicle.publisher.start()
        vehicle.publisher.claim(5.0)
        vehicles.append(vehicle)
        return vehicle

    yield start
    for vehicle in vehicles:
        vehicle.publisher.close()


def comes(seen: Subscription, vehicle: Vehicle, sample: ControlSample, within_s: float) -> bool:
    until_s = time.monotonic() + within_s
    while time.monotonic() < until_s:
        vehicle.publisher.offer(sample)
        if seen.take():
            return True
        time.sleep(0.02)
    return False


def tell(seen: Subscription, vehicle: Vehicle) -> Reply:
    """Tell while the publisher is being fed, as it always is."""
    return seen.tell("kelp", "setpoint", {"depth_m": 3.0})


def test_the_laptop_sees_and_may_not_command(
    diving: Callable[..., Vehicle], make_sample: Callable[..., ControlSample]
) -> None:
    vehicle = diving(allow_control=False)
    with Subscription("holdfast/**", str(vehicle.laptop)) as seen:
        assert comes(seen, vehicle, make_sample(), 10.0)
        assert seen.ask(telemetry.config_key("kelp"), timeout_s=2.0) == b"{}"
        answer = seen.ask(telemetry.command_key("kelp", "setpoint"), b"{}", timeout_s=1.0)
        assert answer is None
        assert seen.ask("holdfast/kelp/command/*", b"{}", timeout_s=1.0) is None
        assert seen.ask("holdfast/kelp/comman$*/setpoint", b"{}", timeout_s=1.0) is None
        tails = {message.key.split("/", 2)[2] for message in seen.last()}
        assert tails == {*telemetry.EVERY_TICK, "config", "choices", "check"}
    assert vehicle.commands == []


def test_the_laptop_commands_where_it_was_allowed_and_publishes_nothing(
    diving: Callable[..., Vehicle], make_sample: Callable[..., ControlSample]
) -> None:
    vehicle = diving(allow_control=True)
    with Subscription("holdfast/**", str(vehicle.laptop)) as seen:
        assert comes(seen, vehicle, make_sample(), 10.0)
        assert tell(seen, vehicle).done
    assert vehicle.commands == ["setpoint"]
    with (
        Subscription("holdfast/other/**", vehicle.local) as local,
        zenoh.open(client_configuration(str(vehicle.laptop))) as laptop,
    ):
        assert not _put_seen(laptop, local), "a laptop must not pretend to be a vehicle"
    with (
        Subscription("holdfast/other/**", vehicle.local) as local,
        zenoh.open(client_configuration(vehicle.local)) as neighbour,
    ):
        assert _put_seen(neighbour, local), "processes on the vehicle may publish"


@pytest.mark.alone
def test_over_a_radio_whole_ticks_come_and_few_of_them(
    diving: Callable[..., Vehicle], make_sample: Callable[..., ControlSample]
) -> None:
    vehicle = diving(allow_control=False, radio=True)
    with (
        Subscription("holdfast/**", str(vehicle.laptop)) as laptop,
        Subscription("holdfast/**", vehicle.local) as local,
    ):
        assert comes(laptop, vehicle, make_sample(), 10.0)
        assert comes(local, vehicle, make_sample(), 10.0)
        time.sleep(0.5)
        laptop.take(), local.take()
        for tick in range(50):
            vehicle.publisher.offer(
                make_sample(t_s=float(tick)), telemetry.Raw(tick=tick, now_s=1.0, heard=[], out=[])
            )
            time.sleep(0.02)
        until(lambda: any(b'"t_s":49.0' in payload for _, payload in local.take()))
        keys_of = Counter(json.loads(payload)["t_s"] for _, payload in laptop.take())
    assert 3 <= len(keys_of) <= 8
    assert set(keys_of.values()) == {len(telemetry.EVERY_TICK)}
    assert ticks_per_sample(str(vehicle.laptop)) == RADIO_TICKS
    assert ticks_per_sample(vehicle.local) == 1


def test_at_a_router_each_vehicle_speaks_for_itself_alone(
    make_sample: Callable[..., ControlSample], tmp_path: Path
) -> None:
    local = f"tcp/127.0.0.1:{free_port()}"
    names = ["kelp", "reed"]
    router, laptop, *vehicles = keys.make(
        tmp_path, ["127.0.0.1"], allow_control=True, now=NOW, vehicles=names, port=free_port(), local=local
    )

    kelps = f"tcp/127.0.0.1:{free_port()}"
    for file, listens in zip(vehicles, ([kelps], []), strict=True):  # the two are on one machine
        config = json.loads(file.read_text())
        assert config["listen"]["endpoints"] == [telemetry.ENDPOINT]
        config["listen"]["endpoints"] = listens
        file.write_text(json.dumps(config))

    def command(received: ReceivedCommand) -> None:
        received.answer(Reply(done=True, said="aye"))

    with ExitStack() as stack:
        enter = stack.enter_context
        publishers = [
            enter(Publisher(name, str(file), "file", command))
            for name, file in zip(names, vehicles, strict=True)
        ]
        for publisher in publishers:
            publisher.claim(10.0)
            publisher.offer(make_sample())
        aboard = enter(Subscription("holdfast/**", kelps))
        seen = enter(Subscription("holdfast/**", str(laptop)))
        here = enter(Subscription("holdfast/**", local))
        tails = {f"{name}/{tail}" for name in names for tail in telemetry.EVERY_TICK}

        def last(client: Subscription) -> set[str]:
            return {message.key.partition("/")[2] for message in client.last()}

        until(lambda: "kelp/state" in last(aboard), 10.0)  # without a router
        enter(zenoh.open(zenoh.Config.from_file(str(router))))
        until(lambda: last(seen) >= tails, 10.0)
        until(lambda: last(here) >= tails, 10.0)
        assert seen.tell("reed", "setpoint", {"depth_m": 3.0}).done
        config["listen"]["endpoints"] = []
        config["transport"] = json.loads(vehicles[0].read_text())["transport"]
        vehicles[1].write_text(json.dumps(config))
        kelp = enter(zenoh.open(client_configuration(str(vehicles[1]))))
        assert not _put_seen(kelp, enter(Subscription("holdfast/other/**", local)))
        assert [reply.ok for reply in kelp.get("holdfast/reed/command/setpoint", timeout=1.0)] == []


def test_a_fleets_names_are_vehicles_names(tmp_path: Path) -> None:
    for names in (["kelp", "kelp"], ["router"], ["a/b"]):
        with pytest.raises(ValueError, match="vehicle name"):
            keys.make(tmp_path, ["10.0.0.1"], allow_control=False, now=NOW, vehicles=names)
    assert list(tmp_path.iterdir()) == []


def test_another_authoritys_certificate_and_none_are_refused(
    diving: Callable[..., Vehicle], make_sample: Callable[..., ControlSample], tmp_path: Path
) -> None:
    vehicle = diving(allow_control=True)
    right = json.loads(vehicle.laptop.read_text())
    tls = right["transport"]["link"]["tls"]
    _, strangers = keys.make(tmp_path / "stranger", ["127.0.0.1"], allow_control=True, now=NOW)
    wrong = json.loads(strangers.read_text())["transport"]["link"]["tls"]
    authority = "root_ca_certificate_base64"
    for name, presented in {
        "other": {**wrong, authority: tls[authority]},
        "none": {authority: tls[authority]},
    }.items():
        right["transport"]["link"]["tls"] = presented
        file = tmp_path / f"{name}.json5"
        file.write_text(json.dumps(right))
        with Subscription("holdfast/**", str(file)) as seen:
            assert not comes(seen, vehicle, make_sample(), 2.0), name


def test_a_vehicle_that_is_not_the_one_meant_is_refused(
    diving: Callable[..., Vehicle], make_sample: Callable[..., ControlSample], tmp_path: Path
) -> None:
    vehicle = diving(allow_control=True)
    laptop = json.loads(vehicle.laptop.read_text())
    laptop["connect"]["endpoints"] = [laptop["connect"]["endpoints"][0].replace("127.0.0.1", "localhost")]
    file = tmp_path / "elsewhere.json5"
    file.write_text(json.dumps(laptop))
    with Subscription("holdfast/**", str(file)) as seen:
        assert not comes(seen, vehicle, make_sample(), 2.0)


def test_keys_in_use_are_not_written_over(tmp_path: Path) -> None:
    files = keys.make(tmp_path, ["rov.local", "fe80::1"], allow_control=False, now=NOW)
    assert all(file.stat().st_mode & 0o777 == 0o600 for file in files)
    assert "tls/[fe80::1]:7448" in files[1].read_text()
    with pytest.raises(FileExistsError):
        keys.make(tmp_path, ["rov.local"], allow_control=False, now=NOW)


def _put_seen(session: zenoh.Session, seen: Subscription) -> bool:
    until_s = time.monotonic() + 1.0
    while time.monotonic() < until_s:
        session.put("holdfast/other/state", b"{}")
        time.sleep(0.05)
        if seen.take():
            return True
    return False
