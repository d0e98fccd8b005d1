"""`holdfast install`: the services of systemd and the configuration, for the installation that runs this."""

import os
import pwd
import shutil
import subprocess
import sys
from pathlib import Path

from holdfast import DONE, FAILED, RefusedError
from holdfast.command_line import command_parser

EXAMPLES = """\
examples:
  holdfast install             as root: write and start the services; again after an upgrade, or where an
                               endpoint became a serial line
  holdfast install --remove    stop and remove them; configuration and dives stay

The services holdfast, holdfast-record and holdfast-dashboard start now and at every boot;
holdfast-sim@VEHICLE does not. /etc/holdfast/companion.toml is written once, and kept. Nothing moves the
vehicle until it is told to engage. Upgrade by pip, then install again: docs/install.md.
"""

PACKAGE = Path(__file__).parent
TEMPLATES = next(folder / "systemd" for folder in (PACKAGE, PACKAGE.parent) if (folder / "systemd").is_dir())
"""The units, in an installation or a checkout. They start `IN_TEMPLATES`."""
IN_TEMPLATES = "/opt/holdfast/bin/holdfast"
PROGRAM = Path(sys.prefix) / "bin" / "holdfast"
LINK = Path("/usr/local/bin/holdfast")
UNITS = Path("/usr/local/lib/systemd/system")
"""systemd's folder for what no package brings; changes of the machine's owner are in /etc/systemd/system."""
SERIAL = Path("holdfast.service.d/serial.conf")
CONFIGURATION = Path("/etc/holdfast/companion.toml")
BEGUN = CONFIGURATION.with_name("installing")
"""There until a first installation is finished: a repeated one then enables and starts the services too."""
RUNNING = Path("/run/systemd/system")
"""There while systemd runs; in an image that is being built it is not."""
USER = "holdfast-record"
"""Owns the dives. The other services have no user: systemd lends each one of its own while it runs."""
ENABLED = ("holdfast.service", "holdfast-record.service", "holdfast-dashboard.service")
ALL = "holdfast*.service"
STEERS = ("ACTIVE", "RAMP_DOWN", "HAND_OVER")
"""The supervisor's states in which Holdfast sends thrust."""
HIDDEN = ("/home/", "/root/")
"""Folders that the services do not see (ProtectHome=)."""


def install(argv: list[str]) -> int:
    """Install Holdfast as services of systemd, or remove them."""
    parser = command_parser(
        "install",
        "Writes the units of systemd for controller, recorder and dashboard, and the configuration if there "
        "is none, and starts them.",
        EXAMPLES,
    )
    parser.add_argument("--remove", action="store_true", help="stop the services and remove their units")
    remove = parser.parse_args(argv).remove
    _refuse_what_cannot_be(remove=remove)
    os.umask(0o022)
    try:
        _refuse_while_held()
        (_remove if remove else _install)()
    except subprocess.CalledProcessError as error:
        said = " / ".join((error.stdout + error.stderr).split("\n")[-4:])
        sys.stderr.write(f"holdfast install: `{' '.join(error.cmd)}` failed: {said}; repeat this command\n")
        return FAILED
    return DONE


def _install() -> None:
    import dashboard.recording.record  # here it is refused, in words, if an extra is not there
    import dashboard.web.app  # noqa: F401
    from companion.assembly import refuse_fast_gains
    from companion.config import DEFAULT_FILE, load_config
    from companion.endpoint import Endpoint

    try:
        config = load_config(CONFIGURATION if CONFIGURATION.exists() else DEFAULT_FILE)
        refuse_fast_gains(config)
    except RefusedError:
        raise
    except Exception as error:  # a law or compensator of its owner's
        raise RefusedError(f"{CONFIGURATION}: leads to {error!r}: correct it, and repeat") from error
    files = {Path(file.name): file.read_text(encoding="utf-8") for file in TEMPLATES.glob("*.service")}
    files = {name: text.replace(IN_TEMPLATES, str(PROGRAM)) for name, text in files.items()}
    ends = (Endpoint.parse(text) for text in (config.link.endpoint, config.ground_station.endpoint) if text)
    devices = [end.place.replace("%", "%%") for end in ends if end.kind == "serial"]
    if devices:
        allowed = "".join(f"DeviceAllow={device} rw\n" for device in devices)
        files[SERIAL] = (
            f"# From the endpoints in {CONFIGURATION}, by `holdfast install`.\n"
            f"[Service]\nPrivateDevices=no\n{allowed}SupplementaryGroups=dialout\n"
        )
    else:
        (UNITS / SERIAL).unlink(missing_ok=True)
    first = BEGUN.exists() or not any((UNITS / name).exists() for name in ENABLED)
    if first:
        _write(BEGUN, "`holdfast install` was cut off: repeat it\n")
    if not CONFIGURATION.exists():
        _write(CONFIGURATION, DEFAULT_FILE.read_text(encoding="utf-8"))
    if not _is_user(USER):
        _run("useradd", "--system", "--no-create-home", "--home-dir", "/", USER)
    for name, text in files.items():
        _write(UNITS / name, text)
    if not LINK.exists():
        LINK.unlink(missing_ok=True)
        LINK.symlink_to(PROGRAM)
    if RUNNING.is_dir():
        _run("systemctl", "daemon-reload")
    if first:  # whoever disabled a service later keeps it so
        _run("systemctl", "enable", *ENABLED)
    if RUNNING.is_dir():
        _refuse_while_held()  # somebody may have engaged it meanwhile
        _run("systemctl", *(("start", *ENABLED) if first else ("try-restart", ALL)))
    BEGUN.unlink(missing_ok=True)
    sys.stdout.write(
        f"{'started' if first else 'restarted'}: {PROGRAM} by {UNITS}/{ALL}\n"
        f"next: set link.endpoint and vehicle.preset in {CONFIGURATION}, `systemctl restart holdfast`\n"
        "      `systemctl status holdfast` says what it waits for, `holdfast engage` engages\n"
        f"upgrade: `{PROGRAM.with_name('pip')} install -U WHEEL`, then `holdfast install` again\n"
    )


def _remove() -> None:
    if any((UNITS / name).exists() for name in ENABLED):
        _run("systemctl", "disable", *ENABLED)
        if RUNNING.is_dir():
            _refuse_while_held()
            _run("systemctl", "stop", ALL)
    for path in (*UNITS.glob("holdfast.service"), *UNITS.glob("holdfast-*.service"), UNITS / SERIAL):
        path.unlink(missing_ok=True)
    if (UNITS / SERIAL).parent.is_dir():
        (UNITS / SERIAL).parent.rmdir()
    BEGUN.unlink(missing_ok=True)
    if LINK.is_symlink() and LINK.readlink() == PROGRAM:
        LINK.unlink()
    if RUNNING.is_dir():
        _run("systemctl", "daemon-reload")
    if _is_user(USER):
        _run("userdel", USER)
    sys.stdout.write(
        f"removed. Left are {CONFIGURATION.parent}, /var/lib/holdfast*, /var/lib/private/holdfast*, "
        f"/etc/systemd/system/holdfast*.d and the program in {sys.prefix}\n"
    )


def _refuse_what_cannot_be(*, remove: bool) -> None:
    if shutil.which("systemctl") is None:
        raise RefusedError("there is no systemd here. On BlueOS use the extension: docs/install.md")
    for folder in (sys.prefix, sys.base_prefix):
        if not remove and f"{Path(folder).resolve()}/".startswith(HIDDEN):
            raise RefusedError(
                f"this installation uses {folder}, which the services cannot read. Make another: "
                "sudo /usr/bin/python3 -m venv /opt/holdfast; sudo /opt/holdfast/bin/pip install WHEEL; "
                "sudo /opt/holdfast/bin/holdfast install"
            )
    if os.geteuid() != 0:
        raise RefusedError("needs root: type sudo before it")


def _refuse_while_held() -> None:
    """Raise RefusedError while Holdfast steers the vehicle: this would restart it."""
    if not RUNNING.is_dir():
        return
    status = _run("systemctl", "show", "--property=StatusText", "--value", "holdfast.service")
    if status.startswith(STEERS):
        raise RefusedError(
            "Holdfast steers the vehicle now, and this would end it. First: holdfast release; then "
            "repeat this command"
        )


def _run(*argv: str) -> str:
    return subprocess.run(argv, check=True, cwd="/", capture_output=True, text=True).stdout.strip()


def _write(path: Path, text: str) -> None:
    """Write a file that everybody may read: a power cut leaves the old file or the new one."""
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{path.name}.new")
    with beside.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    beside.replace(path)


def _is_user(name: str) -> bool:
    return any(user.pw_name == name for user in pwd.getpwall())
