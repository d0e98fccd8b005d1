"""The command lines of `holdfast install` and `holdfast uninstall`."""

import os
import shutil
import sys
from argparse import Namespace
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from sysconfig import get_path
from tempfile import TemporaryDirectory

from holdfast import DONE, FAILED, RefusedError, own_version
from holdfast.arguments import command_parser
from holdfast.install import plan
from holdfast.install.machine import CONFIGURATION, CURRENT, Found, installed, look
from holdfast.install.release import PROJECT, from_wheel, own_wheel
from holdfast.install.steps import Step, StepError, carry_out

WHEEL = f"{PROJECT}-{own_version()}-py3-none-any.whl"
INSTALL_EXAMPLES = f"""\
examples:
  holdfast install                                            what it would do
  sudo holdfast install {WHEEL} --apply
                                                              install it, or change to it
  sudo env PYTHONPATH={WHEEL} python3 -m holdfast install --apply
                                                              the same where no holdfast is installed
  sudo holdfast install {WHEEL} --wheels wheels --apply
                                                              without internet: docs/install.md
  sudo holdfast install --rollback --apply                    back to the version before
  sudo holdfast install --apply                               after link.endpoint became a serial line

It installs into /opt/holdfast, with `holdfast` in /usr/local/bin. The services holdfast, holdfast-record and
holdfast-dashboard start now and at every boot; holdfast-sim@VEHICLE does not. An upgrade keeps /etc/holdfast,
and the version before. Nothing moves the vehicle until it is told to engage.
"""

UNINSTALL_EXAMPLES = """\
examples:
  holdfast uninstall                                          what it would do
  sudo holdfast uninstall --apply                             keep the configuration, keys and dives
  sudo holdfast uninstall --purge --apply                     keep nothing
"""

NUMPY = (2, 2)
"""The oldest that will do, as in pyproject.toml."""
HIDDEN = ("/home/", "/root/")
"""Folders that the services do not see (ProtectHome=)."""


def install(argv: list[str]) -> int:
    """Install Holdfast as services of systemd, upgrade it, or go back."""
    parser = command_parser(
        "install",
        "Installs the controller, the recorder and the dashboard as services of systemd. "
        "Without --apply it prints what it would do, and changes nothing.",
        INSTALL_EXAMPLES,
    )
    parser.add_argument(
        "wheel",
        nargs="?",
        type=Path,
        metavar="WHEEL",
        help="the wheel to install; default: the one that this program was installed from",
    )
    parser.add_argument(
        "--wheels",
        type=Path,
        metavar="DIR",
        help="take what it needs from this folder, not from the internet",
    )
    parser.add_argument("--rollback", action="store_true", help="change to the version before this one")
    parser.add_argument("--apply", action="store_true", help="do it; needs root")
    arguments = parser.parse_args(argv)
    _refuse_without_systemd()
    with TemporaryDirectory(prefix="holdfast-") as folder:
        return _installed(arguments, Path(folder))


def _installed(arguments: Namespace, folder: Path) -> int:
    found = look()
    if arguments.rollback:
        if arguments.wheel or arguments.wheels:
            raise RefusedError("--rollback takes no wheel: it goes back to the version before")
        release = installed(plan.version_before(found))
    elif arguments.wheel is None and found.current and _runs_from(CURRENT):
        release = installed(found.current)
    else:
        release = from_wheel(arguments.wheel or own_wheel(folder))
    if release.wheel is not None:
        _refuse_unfit_python(found)
    wheels = arguments.wheels.resolve(strict=True) if arguments.wheels else None
    steps = plan.install(found, release, sys.executable, wheels, back=arguments.rollback)
    status = _done(found, steps, f"{release.name} is in use", "install", apply=arguments.apply)
    if status == DONE and arguments.apply and steps and found.running:
        sys.stdout.write(
            f"next: set link.endpoint and vehicle.preset in {CONFIGURATION}, `systemctl restart holdfast`\n"
            "      `systemctl status holdfast` says what it waits for, `holdfast tell NAME engage` engages\n"
            if not found.current
            else "`systemctl status holdfast` shows what it does; `holdfast install --rollback` goes back\n"
        )
    return status


def uninstall(argv: list[str]) -> int:
    """Remove the services and all that `holdfast install` installed."""
    parser = command_parser(
        "uninstall",
        "Removes what `holdfast install` installed. Without --apply it prints what it would do.",
        UNINSTALL_EXAMPLES,
    )
    parser.add_argument(
        "--purge", action="store_true", help="also remove /etc/holdfast and the dives in /var/lib"
    )
    parser.add_argument("--apply", action="store_true", help="do it; needs root")
    arguments = parser.parse_args(argv)
    found = look()
    steps = plan.uninstall(found, purge=arguments.purge)
    status = _done(found, steps, "nothing is installed", "uninstall", apply=arguments.apply)
    if found.owned and not arguments.purge:
        sys.stdout.write(f"left, for --purge: {', '.join(map(str, found.owned))}\n")
    return status


def _done(found: Found, steps: list[Step], nothing: str, command: str, *, apply: bool) -> int:
    """Print the steps and, if asked, carry them out; return the exit status."""
    if not steps:
        sys.stdout.write(f"nothing to do: {nothing}\n")
        return DONE
    if not apply:
        sys.stdout.write("".join(f"would {step}\n" for step in steps))
        sys.stdout.write("nothing was changed; --apply does it, as root\n")
        return DONE
    if os.geteuid() != 0:
        raise RefusedError("--apply needs root: type sudo before it")
    try:
        carry_out(steps, _say)
    except StepError as error:
        back = "; `holdfast install --rollback --apply` goes back" if _changed_from(found) else ""
        sys.stderr.write(f"holdfast {command}: {error}{back}\n")
        return FAILED
    return DONE


def _say(line: str) -> None:
    sys.stdout.write(line)
    sys.stdout.flush()


def _changed_from(previous: Found) -> bool:
    return bool(previous.current) and look().current not in ("", previous.current)


def _runs_from(folder: Path) -> bool:
    return Path(sys.prefix) == folder.resolve()


def _refuse_without_systemd() -> None:
    if shutil.which("systemctl") is None:
        raise RefusedError("there is no systemd here. On BlueOS use the extension: docs/install.md")


def _refuse_unfit_python(found: Found) -> None:
    if find_spec("ensurepip") is None:
        raise RefusedError("this Python makes no virtual environments: sudo apt-get install python3-venv")
    base = str(Path(sys.base_prefix).resolve()) + "/"
    if base.startswith(HIDDEN):
        raise RefusedError(
            f"this Python is in {base}, which the services cannot read; use the system's: "
            "sudo env PYTHONPATH=WHEEL /usr/bin/python3 -m holdfast install"
        )
    if found.bits == 32 and not _has_what_debian_brings():
        raise RefusedError(
            "a 32-bit system needs packages of Debian 13 or Raspberry Pi OS 13, or a newer one: sudo apt-get "
            "install gcc python3-dev python3-numpy python3-lz4 python3-zstandard python3-cffi-backend"
        )


def _has_what_debian_brings() -> bool:
    modules = ("numpy", "lz4", "zstandard", "_cffi_backend")
    return (
        all(find_spec(name) for name in modules)
        and tuple(map(int, version("numpy").split(".")[:2])) >= NUMPY
        and shutil.which("gcc") is not None
        and (Path(get_path("include")) / "Python.h").exists()
    )
