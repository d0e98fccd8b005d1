"""The command line of `holdfast dashboard`, and the server that it starts."""

import asyncio
import errno
import logging
import secrets
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from aiohttp import web

from dashboard.arguments import WHERE, add_connect
from dashboard.web import connections
from dashboard.web.app import Dashboard
from holdfast import files, port_taken
from holdfast.command_line import address, command_parser

SHORTEST_TOKEN = 16  # 64 bits in hex digits

EXAMPLES = f"""\
examples:
  holdfast dashboard                            then open http://127.0.0.1:8600/
  holdfast dashboard --allow-control            also engage, release, aim and tune, with the token it prints
  holdfast dashboard --connect laptop.json5     on a laptop, by TLS
  holdfast dashboard --listen 0.0.0.0:8600 --host blueos.local
                                                for others on the network too; by number or by that name
{WHERE}
It opens with the pilot's view; /engineer has plots and gains. It needs no internet. Press ? there for the
keys. Each panel also stands alone, as /panel/depth; Cockpit finds them as widgets by /register_service.

Control needs `--allow-control` here, the token in the browser and, unless this runs on the companion's own
machine, a companion started with `holdfast run --allow-control`. The token travels unencrypted: keep a
dashboard with --allow-control on 127.0.0.1 or on a network that is yours.
"""


@dataclass(frozen=True)
class DashboardOptions:
    """What the command line says. Without `token` nothing can be sent; without `token_file` it was made."""

    host: str
    port: int
    names: tuple[str, ...]
    endpoint: str
    token: str
    token_file: Path | None = None


def settings(argv: list[str]) -> DashboardOptions:
    """Read the command line; raise ValueError, in words, for what cannot be."""
    parser = command_parser(
        "dashboard",
        "Serves a web page for pilots and control engineers: every vehicle that publishes over Zenoh, live.",
        EXAMPLES,
    )
    add = parser.add_argument
    listen = "address of the page (default %(default)s: this machine only)"
    add("--listen", metavar="HOST:PORT", type=address, default="127.0.0.1:8600", help=listen)
    names = "a host name that browsers may use, besides numbers and localhost; may be repeated"
    add("--host", metavar="NAME", action="append", default=[], help=names)
    add_connect(parser)
    add("--allow-control", action="store_true", help="accept commands from users with the token")
    token = f"file with the token, {SHORTEST_TOKEN} characters or more; default: a new token"
    add("--token-file", metavar="FILE", type=Path, help=token)
    options = parser.parse_args(argv)
    if options.token_file and not options.allow_control:
        raise ValueError("--token-file: without --allow-control there is nothing to unlock")
    token = ""
    if options.allow_control:
        token = _token(options.token_file) if options.token_file else secrets.token_urlsafe(18)
    host, port = options.listen
    return DashboardOptions(host, port, tuple(options.host), options.connect, token, options.token_file)


def announcement(options: DashboardOptions, port: int, *, terminal: bool) -> str:
    """Return what the dashboard says of itself. A token that is in a file is not repeated in a log."""
    shown = "127.0.0.1" if options.host in ("0.0.0.0", "::") else options.host
    page = f"dashboard: http://{f'[{shown}]' if ':' in shown else shown}:{port}/"
    if options.token_file is not None and not terminal:
        return f"{page} unlock it with the token in {options.token_file}"
    return f"{page}#token={options.token}" if options.token else page


def _token(file: Path) -> str:
    try:
        token = files.text(file).strip()
    except (OSError, ValueError) as error:
        raise ValueError(f"--token-file {file}: cannot be read: {error}") from error
    if len(token) < SHORTEST_TOKEN or not token.isascii() or not token.isprintable() or " " in token:
        raise ValueError(
            f"--token-file {file}: want {SHORTEST_TOKEN} or more plain characters without spaces; "
            "`openssl rand -hex 16` makes some"
        )
    return token


async def serve(options: DashboardOptions, stop: asyncio.Event, listening: Callable[[int], None]) -> None:
    """Serve until `stop`; tell `listening` the port. Raises OSError where it is taken."""
    dashboard = Dashboard(options.endpoint, options.names, options.token)
    runner = web.AppRunner(dashboard.application(), access_log=None, shutdown_timeout=1.0)
    await runner.setup()
    http, opened = runner.server, dict[connections.Connection, None]()
    assert http is not None
    try:
        server = await asyncio.get_running_loop().create_server(
            lambda: connections.Connection(http, opened),
            options.host,
            options.port,
            backlog=connections.MOST,
        )
        listening(server.sockets[0].getsockname()[1])
        await stop.wait()
        server.close()
    finally:
        await runner.cleanup()


async def _serve(options: DashboardOptions) -> None:
    stop = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)

    def announce(port: int) -> None:
        sys.stdout.write(announcement(options, port, terminal=sys.stdout.isatty()) + "\n")
        sys.stdout.flush()

    await serve(options, stop, announce)


def main(argv: list[str]) -> int:
    """Serve until SIGINT or SIGTERM; return the exit status."""
    try:
        options = settings(argv)
    except ValueError as error:
        sys.stderr.write(f"holdfast dashboard: {error}\n")
        return 2
    log = logging.StreamHandler()
    log.addFilter(connections.is_ours)
    logging.basicConfig(level=logging.WARNING, format="%(asctime)s %(message)s", handlers=[log])
    try:
        asyncio.run(_serve(options))
    except OSError as error:
        if error.errno != errno.EADDRINUSE:
            raise
        sys.stderr.write(f"holdfast dashboard: {port_taken('tcp', options.port)} with --listen\n")
        return 1
    return 0
