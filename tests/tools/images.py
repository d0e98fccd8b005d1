"""Builds the BlueOS extension's image for each architecture, and dives each in this machine's simulator.

usage: sudo .venv/bin/python -m tests.tools.images [--base IMAGE] [armhf] [arm64] [amd64]

Needs the wheel in dist/ (`make wheel`), buildah, and for a foreign architecture qemu-user-static. The line
"here" is this checkout without an image; depth and tick are of virtual time. Exit status 1: an image is too
large, does not hold, or its `holdfast run` does not tick.
"""

import argparse
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import msgspec

from dashboard.zenoh_client import Subscription

from .processes import HOLDFAST, free_port, running

PLATFORMS = {"armhf": "linux/arm/v7", "arm64": "linux/arm64", "amd64": "linux/amd64"}
QEMU = {"armhf": "qemu-arm", "arm64": "qemu-aarch64"}
CERTIFICATES = "/usr/local/share/ca-certificates"
"""Certificates of this machine's owner, for pip while an image is built."""
BINFMT = Path("/proc/sys/fs/binfmt_misc")

PROGRAM = Path(__file__).with_name("image_dive.py")
START_S = 300.0
MAX_SIZE_MB = 250.0
MAX_ERROR_MM = 10.0


class Dive(NamedTuple):
    """What a dive in waves in virtual time reached, and the processor time of its ticks: `image_dive.py`."""

    error_mm: float
    depth_sd_mm: float
    tick_ms: float
    """Median; 95 % take at most `tick95_ms`."""
    tick95_ms: float


class Installed(NamedTuple):
    """How to start Python and Holdfast of an installation."""

    python: tuple[str, ...]
    holdfast: tuple[str, ...]


HERE = Installed((sys.executable,), HOLDFAST)


def main(argv: list[str]) -> int:
    """Build and dive; return 1 if a bound is missed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--base", metavar="IMAGE", default="docker.io/library/debian:trixie-slim")
    parser.add_argument("architectures", nargs="*", metavar="ARCH", help="default: all three")
    options = parser.parse_args(argv)
    names = options.architectures or list(PLATFORMS)
    if unknown := set(names) - set(PLATFORMS):
        parser.error(f"{', '.join(sorted(unknown))}: known are {', '.join(PLATFORMS)}")
    missed = 0
    say(f"{'size':>16}{'error':>10}{'depth SD':>10}{'tick, median / 95 %':>21}")
    show("here", None, dive(HERE))
    for name in names:
        emulate(name)
        image = build(name, options.base)
        with container(name, image) as (root, installed):
            size_mb, dived = size(root), dive(installed)
            show(name, size_mb, dived)
            wait_for_tick(installed)
        missed += size_mb > MAX_SIZE_MB or not dived.error_mm < MAX_ERROR_MM
    return int(missed > 0)


def show(name: str, size_mb: float | None, dived: Dive) -> None:
    """Print one line of the table."""
    image = f"{size_mb:5.0f} MB" if size_mb else ""
    say(
        f"{name:8}{image:>8}{dived.error_mm:7.1f} mm{dived.depth_sd_mm:7.1f} mm{dived.tick_ms:10.2f} / "
        f"{dived.tick95_ms:5.2f} ms"
    )


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def emulate(name: str) -> None:
    """Let the kernel start programs of this architecture."""
    if name not in QEMU or (BINFMT / QEMU[name]).exists():
        return
    if not (BINFMT / "register").exists():
        call("mount", "-t", "binfmt_misc", "binfmt_misc", str(BINFMT))
    (BINFMT / "register").write_text(Path(f"/usr/lib/binfmt.d/{QEMU[name]}.conf").read_text())


def build(name: str, base: str) -> str:
    """Return the extension's image on a base."""
    image = f"localhost/holdfast:{name}"
    call(
        *("buildah", "bud", "--isolation=chroot", "--layers", f"--platform={PLATFORMS[name]}"),
        *([f"--volume={CERTIFICATES}:{CERTIFICATES}:ro"] if Path(CERTIFICATES).exists() else []),
        *(f"--build-arg=BASE={base}", "--file=blueos/Dockerfile", f"--tag={image}", "."),
    )
    return image


@contextmanager
def container(name: str, image: str) -> Iterator[tuple[Path, Installed]]:
    """Yield the files of an image, and how to start its programs; its loopback is this machine's."""
    new = call("buildah", "from", "--pull-never", f"--platform={PLATFORMS[name]}", image).strip()
    try:
        root = call("buildah", "mount", new).strip()
        inside = "/opt/holdfast/bin"
        yield (
            Path(root),
            Installed(("chroot", root, f"{inside}/python"), ("chroot", root, f"{inside}/holdfast")),
        )
    finally:
        call("buildah", "rm", new)


def size(root: Path) -> float:
    """Return what all files take, in MB."""
    return int(call("du", "-s", "--block-size=1", str(root)).split()[0]) / 1e6


def dive(installed: Installed) -> Dive:
    """Hold a depth in waves in virtual time: no load of this machine changes what it reaches."""
    done = subprocess.run(
        (*installed.python, "-"), input=PROGRAM.read_text(), stdout=subprocess.PIPE, check=True, text=True
    )
    return Dive(**msgspec.json.decode(done.stdout))


def wait_for_tick(installed: Installed) -> None:
    """Let `holdfast run` tick on real clocks beside the simulator, or exit; an emulated one starts slowly."""
    link, zenoh = f"127.0.0.1:{free_port(socket.SOCK_DGRAM)}", f"tcp/127.0.0.1:{free_port()}"
    companion = ("run", "--set", f"link.endpoint=udp-listen:{link}", "--set", f"telemetry.endpoint={zenoh}")
    with (
        running(*HOLDFAST, "sim", "--udp-connect", link, "--tcp", f"127.0.0.1:{free_port()}", "--no-zenoh"),
        running(*installed.holdfast, *companion) as run,
        Subscription("holdfast/*/loop", zenoh) as samples,
    ):
        until_s = time.monotonic() + START_S
        while not samples.take():
            if run.poll() is not None or time.monotonic() > until_s:
                raise SystemExit(f"{' '.join(installed.holdfast)} did not tick in {START_S:g} s")
            time.sleep(0.5)


def call(*command: str) -> str:
    """Run a program and return what it prints; its complaints go to the terminal."""
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
