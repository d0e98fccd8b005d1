"""Who holds a port of this machine: for the message that it is taken."""

from pathlib import Path


def holder(kind: str, port: int) -> str:
    """Return the command and process number of who is bound to a "udp" or "tcp" port; "" if unknown.

    From /proc: the processes of other users are seen by root alone.
    """
    sockets = _sockets(kind, port)
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            if any(str(link.readlink()) in sockets for link in (entry / "fd").iterdir()):
                words = (entry / "cmdline").read_bytes().decode(errors="replace").replace("\0", " ").split()
                return f"'{' '.join(words)[:80]}' (process {entry.name})"
        except OSError:
            continue
    return ""


def taken(kind: str, port: int) -> str:
    """Return the sentence: the port, who holds it, and what to do."""
    who = holder(kind, port) or "another process"
    return f"{kind} port {port} is taken by {who}; end that, or choose another port"


def _sockets(kind: str, port: int) -> set[str]:
    """Return the sockets bound to a port, as links in /proc/PID/fd name them."""
    found = set()
    for table in (Path(f"/proc/net/{kind}"), Path(f"/proc/net/{kind}6")):
        try:
            rows = table.read_text(encoding="ascii").splitlines()[1:]
        except OSError:
            continue
        for row in rows:
            columns = row.split()
            if int(columns[1].rpartition(":")[2], 16) == port:
                found.add(f"socket:[{columns[9]}]")
    return found
