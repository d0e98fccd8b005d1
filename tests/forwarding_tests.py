"""What a vehicle forwards between us and a ground station with a link of its own, by the file's `pilot`."""

from itertools import pairwise

from pilot_station import ENGAGE, HOLD, RELEASE, Shown, command, joined, results
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from virtual import Dive, Somebody, hold

from companion.records import State

OURS, PILOTS = 1, 2


class TwoLinks:
    """The vehicle, with a ground station on its second link: heartbeats, and what it is given to say."""

    def __init__(self, vehicle):
        self._vehicle = vehicle
        self._steps = 0
        self._station = Somebody(255, 190)
        self.says, self.heard = [], b""
        vehicle.open_link(PILOTS)

    def __getattr__(self, name):
        return getattr(self._vehicle, name)

    def step(self, datagrams=()):
        if self._steps % round(1.0 / self._vehicle.step_s) == 0:
            self.says.append(self._station.frame(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)))
        self._steps += 1
        said, self.says = self.says, []
        heard = self._vehicle.step([*datagrams, *((PILOTS, data) for data in said)])
        self.heard += b"".join(data for link, data in heard if link == PILOTS)
        return [(link, data) for link, data in heard if link == OURS]


class Pilot(Shown):
    """A pilot whose ground station has a link of its own: our frames go to the vehicle."""

    def __init__(self, dive):
        super().__init__(dive)
        self.links = dive.loop.vehicle = TwoLinks(dive.vehicle)
        dive.tap.after = self._send

    def _send(self, out, sample):
        self.dive.tap.to_vehicle += self.dive.engine.displayed(sample, self.log.step(sample))

    def run(self, seconds):
        """Return what our component says, as the pilot's link hears it."""
        self.dive.run(seconds)
        data, self.links.heard = self.links.heard, b""
        messages = self.parser.parse_buffer(data) or []
        return [m for m in messages if (m.get_srcSystem(), m.get_srcComponent()) == (1, 25)]


def begun(firmware=None):
    """Return the pilot of a dive that waits to be engaged."""
    dive = Dive("initial.eta=[0,0,2,0,0,0]", setpoint=hold(z=2.0, psi=0.0), engage=False, firmware=firmware)
    dive.tap.promises.asked_otherwise = True
    return Pilot(dive)


def test_words_numbers_commands_and_answers_pass_the_vehicle(pilot):
    messages = pilot.run(10.0)
    pilot.links.says.append(command(ENGAGE))
    begun = pilot.run(12.0)
    assert results(begun) == [mavlink.MAV_RESULT_ACCEPTED]
    assert pilot.dive.state is State.ACTIVE
    texts = joined(begun)
    assert (mavlink.MAV_SEVERITY_NOTICE, "Holdfast ACTIVE: engaged") in texts
    heartbeats = [m for m in begun if m.get_type() == "HEARTBEAT"]
    assert {(m.type, m.autopilot) for m in heartbeats} == {
        (mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID)
    }
    last = {m.name: m.value for m in begun if m.get_type() == "NAMED_VALUE_FLOAT"}
    assert last["HfState"] == 2
    assert abs(last["HfDepthErr"]) < 0.1
    assert 0.0 < last["HfReserve"] < 100.0
    sequence = [m.get_seq() for m in messages + begun]
    lost = sum((now - before - 1) % 256 for before, now in pairwise(sequence))
    assert lost == 0, "of all that we said since the second link was heard"

    pilot.dive.loop.engine.aim(hold(z=5.0, psi=0.0))
    pilot.run(2.0)
    pilot.links.says.append(command(HOLD))
    assert results(pilot.run(3.0)) == [mavlink.MAV_RESULT_ACCEPTED]
    assert 2.0 < pilot.dive.step.sample.eta_d[2] < 4.0
    pilot.links.says.append(command(RELEASE))
    assert results(pilot.run(2.0)) == [mavlink.MAV_RESULT_ACCEPTED]
    assert pilot.dive.state is not State.ACTIVE
    pilot.links.says.append(command(RELEASE, target=(1, 1)))
    assert results(pilot.run(2.0)) == [], "the autopilot's own commands are not ours"


def test_the_autopilot_keeps_its_own_counsel(pilot):
    """Our words and numbers change nothing in the firmware: it says nothing of them."""
    pilot.run(12.0)
    pilot.links.heard = b""
    pilot.dive.run(10.0)
    messages = pilot.parser.parse_buffer(pilot.links.heard) or []
    theirs = {m.text for m in messages if m.get_type() == "STATUSTEXT" and m.get_srcComponent() == 1}
    assert not {text for text in theirs if "Hf" in text or "Holdfast" in text or "251" in text}
