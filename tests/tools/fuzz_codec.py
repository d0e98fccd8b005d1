"""Coverage-guided fuzzing of what takes bytes from outside: `fuzz_codec.py -max_total_time=60`.

Half of the inputs are raw datagrams or pieces of a stream. The other half name a message and its payload, and
get the checksum that no mutation would ever guess: they reach the converter behind the codec. Any exception,
any event that is not finite and any buffer that grows is a finding; libFuzzer writes the input that did it.
"""

import math
import sys
from typing import get_args

import atheris

with atheris.instrument_imports(include=["companion.mavlink"]):
    from companion.config import LinkSection
    from companion.mavlink.ardusub import DepthSource
    from companion.mavlink.codec import Codec
    from companion.mavlink.decode import Decoder
    from companion.mavlink.freshness import Freshness

from pymavlink.dialects.v20 import ardupilotmega as mavlink

DEPTHS: tuple[DepthSource, ...] = get_args(DepthSource)
LONGEST_FRAME = 280


def frame(message_id: int, payload: bytes, system: int, component: int) -> bytes:
    """Return a MAVLink 2 frame with the right checksum."""
    kind = mavlink.mavlink_map[message_id]
    payload = payload[: kind.unpacker.size].rstrip(b"\0") or b"\0"
    head = bytes((len(payload), 0, 0, 7, system, component)) + message_id.to_bytes(3, "little")
    checksum: int = mavlink.x25crc(head + payload + bytes((kind.crc_extra,))).crc
    return b"\xfd" + head + payload + checksum.to_bytes(2, "little")


def try_one(data: bytes) -> None:
    """Take one input through codec, converter and freshness."""
    source = atheris.FuzzedDataProvider(data)
    stream = source.ConsumeBool()
    codec = Codec(LinkSection(), stream=stream)
    convert = Decoder(
        codec.counters,
        depth_source=DEPTHS[source.ConsumeIntInRange(0, len(DEPTHS) - 1)],
    )
    ids = sorted(convert.ids)
    fresh = Freshness()
    t_s = 0.0
    while source.remaining_bytes():
        if source.ConsumeBool():
            chunk = source.ConsumeBytes(source.ConsumeIntInRange(0, 600))
        else:
            message_id = ids[source.ConsumeIntInRange(0, len(ids) - 1)]
            sender = (1, 1) if source.ConsumeBool() else (source.ConsumeIntInRange(0, 255), 1)
            chunk = frame(message_id, source.ConsumeBytes(255), *sender)
        t_s += 0.02
        for message in codec.decode(t_s, chunk).messages:
            for event in fresh.drop_stale(convert.to_events(message, t_s)):
                values = [getattr(event, name) for name in event.__struct_fields__]
                assert all(math.isfinite(v) for v in values if isinstance(v, float)), event
        assert len(codec.splitter.rest) < LONGEST_FRAME


if __name__ == "__main__":
    atheris.Setup(sys.argv, try_one)
    atheris.Fuzz()
