"""`holdfast init` finds a vehicle that speaks, and says nothing to what does not."""

import logging
import socket
import threading
from contextlib import closing

import pytest
from tools.processes import HOLDFAST, free_port, running
from waiting import until

from companion.config import load_config
from companion.predive.search import Found, search


def test_a_vehicle_is_found_with_firmware_frame_and_the_nearest_preset() -> None:
    port, quiet = free_port(), f"udp-listen:127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    simulator = ("sim", "--vehicle", "bluerov2", "--tcp", f"127.0.0.1:{port}", "--no-zenoh")
    with running(*HOLDFAST, *simulator):
        until(lambda: _open(port))
        found = search(load_config(), [[quiet], [quiet, f"tcp:127.0.0.1:{port}"]])
    assert found == Found(f"tcp:127.0.0.1:{port}", "ArduSub 4.7.0 (dev)", "vectored", "bluerov2")


def test_what_is_no_vehicle_hears_nothing() -> None:
    heard: list[bytes] = []

    def listen(server: socket.socket) -> None:
        client, _ = server.accept()
        with client:
            client.sendall(b"$GPGGA,no mavlink*00\r\n")
            while data := client.recv(999):
                heard.append(data)

    with closing(socket.create_server(("127.0.0.1", 0))) as server:
        thread = threading.Thread(target=listen, args=(server,))
        thread.start()
        assert search(load_config(), [[f"tcp:127.0.0.1:{server.getsockname()[1]}"]]) is None
        thread.join(5.0)
    assert heard == []


def _open(port: int) -> bool:
    with socket.socket() as client:
        return client.connect_ex(("127.0.0.1", port)) == 0


def test_what_is_logged_after_the_search_is_what_was_logged_before(caplog: pytest.LogCaptureFixture) -> None:
    """Links that failed in the same process were no longer told."""
    caplog.set_level(logging.WARNING, "holdfast")
    search(load_config(), [])
    assert logging.getLogger("holdfast").level == logging.WARNING
