"""Shell completion: shtab writes a script from the parsers of all commands."""

import argparse
from importlib.metadata import EntryPoint

import shtab

from holdfast import ABOUT, commands_by_name, summary
from holdfast.arguments import DESCRIBE, DescribedError

SHELLS = ("bash", "zsh", "fish")

EXAMPLES = """\
examples:
  holdfast completion bash > ~/.local/share/bash-completion/completions/holdfast
  holdfast completion bash > /usr/local/share/bash-completion/completions/holdfast    for everybody, as root
  holdfast completion zsh > ~/.local/share/zsh/site-functions/_holdfast
  holdfast completion fish > ~/.config/fish/completions/holdfast.fish
bash needs the package bash-completion, zsh the folder in its fpath.
"""


def script(shell: str) -> str:
    """Return the script for one of SHELLS."""
    root = argparse.ArgumentParser(prog="holdfast", description=ABOUT)
    root.add_argument("-V", "--version", action="store_true", help="print the version")
    commands = root.add_subparsers()
    for name, entry in sorted(commands_by_name().items()):
        commands.add_parser(name, help=summary(entry), add_help=False, parents=_parser(entry))
    return shtab.complete(root, shell)


def _parser(entry: EntryPoint) -> list[argparse.ArgumentParser]:
    """Return the parser of a command; none where the command needs an extra that is not installed."""
    try:
        entry.load()([DESCRIBE])
    except DescribedError as described:
        return [described.parser]
    except ModuleNotFoundError:
        pass
    return []
