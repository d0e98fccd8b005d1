"""Whatever bytes come to the physics' socket: nothing raises, and the reply stays readable and finite."""

import json
import math
import struct

from hypothesis import given
from hypothesis import strategies as st

from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.physics.body import Physics
from sim_bridge.physics.json_physics import DrivenBody, Responder
from sim_bridge.sim_config import load_config

CONFIG = load_config(DEFAULT_CONFIG)
WORDS = st.integers(0, 65535)
FRAMES = st.builds(
    lambda magic, rate, number, pwm: struct.pack(f"<HHI{len(pwm)}H", magic, rate, number, *pwm),
    st.sampled_from((18458, 29569, 0)),
    WORDS,
    st.integers(0, 2**32 - 1),
    st.one_of([st.lists(WORDS, min_size=n, max_size=n) for n in (15, 16, 32)]),
)


def finite(value):
    if isinstance(value, dict):
        return all(map(finite, value.values()))
    return all(map(finite, value)) if isinstance(value, list) else math.isfinite(value)


@given(st.lists(st.tuples(st.one_of(st.binary(max_size=100), FRAMES), st.floats(0, 5)), max_size=40))
def test_no_bytes_raise_and_every_reply_is_finite(packets):
    body = DrivenBody(Physics(CONFIG, 1), CONFIG.battery.voltage_v)
    responder = Responder(body.move)
    for packet, now_s in packets:
        reply = responder.answer(packet, now_s)
        assert reply is None or finite(json.loads(reply))
