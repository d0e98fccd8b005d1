"""A configuration as text: other values in the lines of a commented TOML file."""

import json
import re
from collections.abc import Mapping
from functools import partial


def with_values(text: str, values: Mapping[str, float | str]) -> str:
    """Return `text` with values such as {"heave.kappa_per_s": 8.0} in place of its own; comments stay.

    Raises KeyError for a key that the text does not have.
    """
    for key, value in values.items():
        section, name = key.split(".")
        shown = json.dumps(value) if isinstance(value, str) else repr(value)
        line = re.compile(rf"(^\[{section}\][^\n]*\n(?:(?!\[).*\n)*?{name} = )([^#\n]*)(.*$)", re.MULTILINE)
        text, count = line.subn(partial(_replaced, shown), text)
        if count != 1:
            raise KeyError(key)
    return text


def _replaced(shown: str, line: re.Match[str]) -> str:
    """Return a line with another value; what follows stays in its column where there is room."""
    value = shown.ljust(len(line[2]) - 1) + " " if line[3] else shown
    return line[1] + value + line[3]
