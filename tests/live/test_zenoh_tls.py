"""The Zenoh configurations of docs/examples/zenoh, with certificates by the recipe of docs/telemetry.md."""

import json
import re
import subprocess
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import zenoh
from tools.processes import free_port
from waiting import until

from companion.io.command_queue import ReceivedCommand
from companion.io.zenoh_publisher import Publisher
from companion.records import ControlSample
from companion.telemetry import schemas as telemetry
from companion.telemetry.schemas import Reply
from companion.telemetry.session import client_configuration, ticks_per_sample
from dashboard.zenoh_client import Subscription

DOCS = Path(__file__).parents[2] / "docs"
EXAMPLES = DOCS / "examples" / "zenoh"
TLS_PORT, LOCAL = "7448", "tcp/127.0.0.1:7447"
RECIPE = re.search(r"```\n(NEW=.*?)```", (DOCS / "telemetry.md").read_text(), re.DOTALL)[1]  # type: ignore[index]


def certificates(directory: Path, *names: str) -> None:
    """Run the page's commands, for 127.0.0.1; and the vehicle's also for further names."""
    directory.mkdir()
    recipe = RECIPE.replace("192.168.2.2", "127.0.0.1")
    (vehicle,) = [line for line in recipe.splitlines() if "vehicle" in line]
    further = "\n".join(vehicle.replace("vehicle", name) for name in names)
    subprocess.run(["sh", "-ec", recipe + further], cwd=directory, capture_output=True, check=True)
    assert (directory / "ca.key").stat().st_mode & 0o777 == 0o600


def example(name: str, directory: Path, **changes: str) -> Path:
    """An example for certificates in `directory`, with changes of texts, each of which must be there."""
    text = re.sub(
        r'"(?:/etc/holdfast/)?([a-z]+\.(?:pem|key))"', rf'"{directory}/\1"', (EXAMPLES / name).read_text()
    )
    text = re.sub(r"192\.168\.2\.2|10\.0\.0\.1", "127.0.0.1", text)
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    file = directory / name
    file.write_text(text)
    return file


class Vehicle:
    """A companion's publisher by vehicle.json5, and the commands that reached it."""

    def __init__(self, directory: Path, *, allow_control: bool = False, slow: bool = False) -> None:
        certificates(directory)
        port, self.local = str(free_port()), f"tcp/127.0.0.1:{free_port()}"
        changes = {LOCAL: self.local, TLS_PORT: port}
        permit = {', "no commands"]': "]"} if allow_control else {}
        self.file = example("vehicle.json5", directory, **changes, **permit)
        self.laptop = example("laptop.json5", directory, **{TLS_PORT: port})
        for file in (self.file, self.laptop) if slow else ():
            file.write_text(re.sub(r"(?m)^  //  ", "    ", file.read_text()))
        self.commands: list[str] = []
        self.publisher = Publisher("kelp", str(self.file), "file", self._take)

    def _take(self, received: ReceivedCommand) -> None:
        self.commands.append(received.name)
        received.answer(Reply(done=True, said="aye"))


@pytest.fixture
def diving(tmp_path: Path) -> Iterator[Callable[..., Vehicle]]:
    vehicles: list[Vehicle] = []

    def start(**options: bool) -> Vehicle:
        vehicle = Vehicle(tmp_path / "keys", **options)
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


def test_the_laptop_sees_and_may_not_command(
    diving: Callable[..., Vehicle], make_sample: Callable[..., ControlSample]
) -> None:
    vehicle = diving()
    with Subscription("holdfast/**", str(vehicle.laptop)) as seen:
        assert comes(seen, vehicle, make_sample(), 10.0)
        assert seen.ask(telemetry.key("kelp", "config"), timeout_s=2.0) == b"{}"
        answer = seen.ask(telemetry.key("kelp", "command", "goto"), b"{}", timeout_s=1.0)
        assert answer is None
        assert seen.ask("holdfast/kelp/command/*", b"{}", timeout_s=1.0) is None
        assert seen.ask("holdfast/kelp/comman$*/goto", b"{}", timeout_s=1.0) is None
        tails = {message.key.split("/", 2)[2] for message in seen.last()}
        assert tails == {*telemetry.EVERY_TICK, "config", "choices", "check"}
    assert vehicle.commands == []


def test_the_laptop_commands_where_it_was_allowed_and_publishes_nothing(
    diving: Callable[..., Vehicle], make_sample: Callable[..., ControlSample]
) -> None:
    vehicle = diving(allow_control=True)
    with Subscription("holdfast/**", str(vehicle.laptop)) as seen:
        assert comes(seen, vehicle, make_sample(), 10.0)
        assert seen.tell("kelp", "goto", {"depth_m": 3.0}).done
    assert vehicle.commands == ["goto"]
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


def test_over_a_slow_link_whole_ticks_come_and_few_of_them(
    diving: Callable[..., Vehicle], make_sample: Callable[..., ControlSample]
) -> None:
    vehicle = diving(slow=True)
    with (
        Subscription("holdfast/**", str(vehicle.laptop)) as laptop,
        Subscription("holdfast/**", vehicle.local) as local,
    ):
        assert comes(laptop, vehicle, make_sample(), 10.0)
        assert comes(local, vehicle, make_sample(), 10.0)
        time.sleep(0.5)
        laptop.take(), local.take()
        for tick in range(50):
            vehicle.publisher.offer(make_sample(t_s=float(tick)))
            time.sleep(0.02)
        until(lambda: any(b'"t_s":49.0' in payload for _, payload in local.take()))
        keys_of = Counter(json.loads(payload)["t_s"] for _, payload in laptop.take())
    assert 3 <= len(keys_of) <= 8
    assert set(keys_of.values()) == {len(telemetry.EVERY_TICK)}
    assert ticks_per_sample(str(vehicle.laptop)) == 10
    assert ticks_per_sample(vehicle.local) == 1


def test_at_a_router_each_vehicle_speaks_for_itself_alone(
    make_sample: Callable[..., ControlSample], tmp_path: Path
) -> None:
    local, port = f"tcp/127.0.0.1:{free_port()}", {TLS_PORT: str(free_port())}
    directory = tmp_path / "keys"
    certificates(directory, "router", "kelp", "reed")
    router = example("router.json5", directory, **port, **{LOCAL: local, ', "no commands"]': "]"})
    laptop = example("laptop.json5", directory, **port)
    kelps = f"tcp/127.0.0.1:{free_port()}"
    kelp_file = example("vehicle-at-router.json5", directory, **port, **{LOCAL: kelps}).rename(
        directory / "kelp.json5"
    )
    nowhere = {f'endpoints: ["{LOCAL}"]': "endpoints: []"}  # the two are on one machine
    reed_file = example("vehicle-at-router.json5", directory, **port, **nowhere, kelp="reed")

    def command(received: ReceivedCommand) -> None:
        received.answer(Reply(done=True, said="aye"))

    with ExitStack() as stack:
        enter = stack.enter_context
        for name, file in (("kelp", kelp_file), ("reed", reed_file)):
            publisher = enter(Publisher(name, str(file), "file", command))
            publisher.claim(10.0)
            publisher.offer(make_sample())
        aboard = enter(Subscription("holdfast/**", kelps))
        seen = enter(Subscription("holdfast/**", str(laptop)))
        here = enter(Subscription("holdfast/**", local))
        tails = {f"{name}/{tail}" for name in ("kelp", "reed") for tail in telemetry.EVERY_TICK}

        def last(client: Subscription) -> set[str]:
            return {message.key.partition("/")[2] for message in client.last()}

        until(lambda: "kelp/state" in last(aboard), 10.0)  # without a router
        enter(zenoh.open(zenoh.Config.from_file(str(router))))
        until(lambda: last(seen) >= tails, 10.0)
        until(lambda: last(here) >= tails, 10.0)
        assert seen.tell("reed", "goto", {"depth_m": 3.0}).done
        again = kelp_file.read_text().replace(kelps, f"tcp/127.0.0.1:{free_port()}")
        (directory / "again.json5").write_text(again)
        kelp = enter(zenoh.open(client_configuration(str(directory / "again.json5"))))
        assert not _put_seen(kelp, enter(Subscription("holdfast/other/**", local)))
        assert [reply.ok for reply in kelp.get("holdfast/reed/command/goto", timeout=1.0)] == []


def test_no_certificate_another_authoritys_and_another_vehicle_than_meant_are_refused(
    diving: Callable[..., Vehicle], make_sample: Callable[..., ControlSample], tmp_path: Path
) -> None:
    vehicle = diving(allow_control=True)
    certificates(tmp_path / "stranger")
    right, mine = vehicle.laptop.read_text(), str(tmp_path / "keys" / "laptop")
    wrong = {
        "of another": right.replace(mine, str(tmp_path / "stranger" / "laptop")),
        "none": re.sub(r"connect_(certificate|private_key): .*", "", right),
        "another vehicle": right.replace("tls/127.0.0.1", "tls/localhost"),
    }
    assert len({right, *wrong.values()}) == 4
    for name, text in wrong.items():
        file = tmp_path / "wrong.json5"
        file.write_text(text)
        with Subscription("holdfast/**", str(file)) as seen:
            assert not comes(seen, vehicle, make_sample(), 2.0), name


def _put_seen(session: zenoh.Session, seen: Subscription) -> bool:
    until_s = time.monotonic() + 1.0
    while time.monotonic() < until_s:
        session.put("holdfast/other/state", b"{}")
        time.sleep(0.05)
        if seen.take():
            return True
    return False
