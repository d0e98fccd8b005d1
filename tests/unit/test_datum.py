"""Places of another boot, origin or zero of the depth are told from those of now."""

import pytest

from companion.guidance.datum import Datum, difference

BEFORE = Datum(boot_s=100.0, boots=6, origin_deg=(0.0, 0.0), surface_pa=101_325.0)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"boot_s": 160.0, "surface_pa": 101_400.0}, ""),
        ({"boots": 7}, "the autopilot was restarted meanwhile"),
        ({"boot_s": 90.0}, "the autopilot was restarted meanwhile"),
        ({"origin_deg": (47.4, 8.55)}, "it was 0.0000000, 0.0000000 and is 47.4000000, 8.5500000"),
        ({"surface_pa": 90e3}, "the zero of the depth has moved by -1.2 m"),
    ],
)
def test_places_are_others_where_what_they_count_from_changed(change, said):
    found = difference(BEFORE, BEFORE._replace(**change))
    assert found is not None
    assert said in found
    assert bool(found) == bool(said)


@pytest.mark.parametrize("now", [BEFORE._replace(boots=None), BEFORE._replace(origin_deg=None)])
def test_while_the_autopilot_has_not_told_nothing_is_known(now):
    assert difference(BEFORE, now) is None
