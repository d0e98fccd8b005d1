"""What an endpoint in the configuration may look like."""

import re
import termios
from typing import NamedTuple, Self

FORMS = "udp-listen:HOST:PORT, udp-connect:HOST:PORT, tcp:HOST:PORT or serial:DEVICE:BAUD"


class Endpoint(NamedTuple):
    """A wire: `kind`, `place` (host or device) and `number` (port or baud)."""

    kind: str
    place: str
    number: int

    @classmethod
    def parse(cls, text: str) -> Self:
        """Take `text` apart; raise ValueError saying what is wrong with it and which forms there are."""
        kind, _, rest = text.partition(":")
        place, _, number = rest.rpartition(":")
        if kind not in ("udp-listen", "udp-connect", "tcp", "serial") or not place:
            raise ValueError(f"write it as {FORMS}")
        if kind == "serial" and not re.fullmatch(r"/\S+", place):
            raise ValueError(f"the device must be a path such as /dev/ttyAMA0; allowed forms: {FORMS}")
        if kind == "serial" and number not in bauds():
            raise ValueError(f"the baud rate must be one of {', '.join(bauds())}; allowed forms: {FORMS}")
        if kind != "serial" and not (re.fullmatch("[0-9]{1,5}", number) and 1 <= int(number) <= 65535):
            raise ValueError(f"the port must be within 1..65535; allowed forms: {FORMS}")
        if place[0] == "[" and place[-1] == "]":
            place = place[1:-1]
        return cls(kind, place, int(number))

    @property
    def is_stream(self) -> bool:
        """Whether frames may come cut in pieces: of TCP and serial lines, never of datagrams."""
        return self.kind in ("tcp", "serial")

    def __str__(self) -> str:
        return f"{self.kind}:{self.place}:{self.number}"


def bauds() -> list[str]:
    """Return the baud rates that this system's termios knows, lowest first."""
    rates = [name[1:] for name in dir(termios) if re.fullmatch("B[1-9][0-9]+", name)]
    return sorted(rates, key=int)
