"""What tells one boot of the real ArduSub from another, and where its places count from."""

from virtual import Dive

from companion.records import GlobalOrigin, Parameter
from lab.loop.firmware import Firmware


def test_it_tells_its_origin_and_how_often_it_was_booted(ardusub):
    dive = Dive(engage=False, firmware=ardusub)
    assert isinstance(dive.vehicle, Firmware)
    events = []
    with dive.vehicle:
        for _ in range(400):
            dive.run(0.02)
            events += dive.engine.events
    (origin,) = (e for e in events if isinstance(e, GlobalOrigin))
    assert 47.0 < origin.latitude_deg < 48.0, "it is asked for once"
    (boots,) = {e.value for e in events if isinstance(e, Parameter) and e.name == "STAT_BOOTCNT"}
    assert boots >= 1.0
