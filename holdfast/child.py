"""Reading an untrusted file in a child process: what it does to its reader, it does to the child alone."""

import multiprocessing
import os
import resource
import signal
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final, TypeVar

from holdfast import RefusedError
from holdfast.files import refuse_endless

MEMORY_BYTES: Final = 2 << 30
"""Memory for data; the libraries and the stacks of their threads take up to a quarter of it."""
START_S, BYTES_PER_S, MAX_S = 20, 100_000, 1200
"""Time of the processor that is allowed: to start, for what the disk has of the files, and at most."""

T = TypeVar("T")


def bounded(read: Callable[..., T], files: Sequence[Path], *arguments: Any) -> T:
    """Return `read(*arguments)`, done within bounds of time and memory.

    `files` are those that it reads. `read` is a function of a module, and what it takes and returns can be
    pickled. Raises OSError as it does, and RefusedError, which names the file, for all else that a file makes
    it do.
    """
    for file in files:
        refuse_endless(file)
    name = ", ".join(map(str, files))
    stored = (512 * file.stat().st_blocks for file in files)  # a sparse file says that it is larger
    seconds = min(START_S + sum(stored) // BYTES_PER_S, MAX_S)
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([read.__module__])
    ours, theirs = context.Pipe(duplex=False)
    work = (theirs, read, arguments, seconds)
    child = context.Process(target=_serve, args=work, daemon=True)
    child.start()
    theirs.close()
    try:
        kind, value = ours.recv()
        if isinstance(value, ValueError) and kind == "error":
            text = " ".join(str(value).split())
            raise RefusedError(text if any(str(file) in text for file in files) else f"{name}: {text}")
        if kind == "error":
            raise value
        return value  # type: ignore[no-any-return]  # what `read` returned, through a pipe
    except EOFError as error:
        child.join()
        if child.exitcode == -signal.SIGXCPU:
            why = f"was not read in {seconds} s: it is damaged, or cut it into parts"
            raise RefusedError(f"{name}: {why}") from error
        raise RefusedError(f"{name}: cannot be read: it ended its reader") from error
    finally:
        child.kill()
        child.join()
        ours.close()


def _serve(pipe: Connection, read: Callable[..., Any], arguments: Sequence[Any], seconds: int) -> None:
    nowhere = os.open(os.devnull, os.O_WRONLY)  # libraries print what they stumble over
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    for what, most in ((resource.RLIMIT_CPU, seconds), (resource.RLIMIT_DATA, MEMORY_BYTES)):
        _, hard = resource.getrlimit(what)
        resource.setrlimit(what, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))
    pipe.send(answer(read, *arguments))


def answer(read: Callable[..., Any], *arguments: Any) -> tuple[str, Any]:
    """Return ("read", what was read), or ("error", what says why not)."""
    try:
        return "read", read(*arguments)
    except (ValueError, OSError, RefusedError) as error:
        return "error", error
    except MemoryError:
        most = MEMORY_BYTES >> 20
        return "error", ValueError(f"needs more than {most} MiB to be read: cut it into parts")
    except Exception as error:  # a reader of others raises whatever a damaged file makes it stumble over
        return "error", ValueError(f"cannot be read: {type(error).__name__}: {error}")
