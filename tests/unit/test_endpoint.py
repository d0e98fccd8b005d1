import pytest

from companion.config import ConfigError, load_config
from companion.endpoint import FORMS, Endpoint


@pytest.mark.parametrize(
    ("text", "parts", "stream"),
    [
        ("udp-listen:0.0.0.0:14550", ("udp-listen", "0.0.0.0", 14550), False),
        ("udp-connect:host.docker.internal:14550", ("udp-connect", "host.docker.internal", 14550), False),
        ("tcp:[::1]:5777", ("tcp", "::1", 5777), True),
        ("serial:/dev/serial/by-id/usb-ArduPilot_Pixhawk1:115200", None, True),
        ("serial:/dev/serial/by-path/pci-0000:00:14.0-usb-0:2:1.0-port0:115200", None, True),
        ("serial:/dev/odd:name:57600", ("serial", "/dev/odd:name", 57600), True),
    ],
)
def test_the_four_forms(text, parts, stream):
    endpoint = Endpoint.parse(text)
    assert parts is None or endpoint == parts
    assert endpoint.is_stream is stream


@pytest.mark.parametrize(
    "text",
    [
        *("", "tcp", "tcp:", "tcp:5760", "tcp::5760", "udp:127.0.0.1:14550", "TCP:127.0.0.1:5760"),
        *("tcp:127.0.0.1:0", "tcp:127.0.0.1:65536", "tcp:127.0.0.1:-1", "tcp:127.0.0.1:٥٧٦", "tcp:a: 5760"),
        *("serial:/dev/ttyACM0", "serial:/dev/ttyACM0:", "serial:/dev/ttyACM0:115201", "serial::115200"),
        *("serial:ttyACM0:115200", "serial:/dev/tty ACM0:115200"),
    ],
)
def test_anything_else_stops_the_start_with_key_value_and_what_is_allowed(text):
    with pytest.raises(ConfigError) as caught:
        load_config(overrides=[f"link.endpoint='{text}'"])
    said = str(caught.value)
    assert "link.endpoint" in said
    assert repr(text) in said
    assert FORMS in said
