"""What the page shares with the companion, as a JavaScript module: names, commands and words."""

import msgspec

from companion.telemetry import glossary
from companion.telemetry.fields import fields_of
from companion.telemetry.glossary import ENDED
from companion.telemetry.modes import MODE_NAMES
from companion.telemetry.operator_commands import COMMANDS

SHARED = (
    *("DEAD_MOTOR", "REVERSED_MOTOR", "ELSEWHERE", "LATE"),
    *("LINK_LOST", "NO_DATA", "NO_VEHICLE", "SERVER_SILENT"),
)
"""Words of the glossary that the page says where the server cannot."""


def module() -> str:
    """Return the module: MODES by number, STATES by name, the fields of each of COMMANDS by name.

    ENDED gives, for the words that a condition has ended, those of its beginning. BY_A_PERSON are
    reasons why control ends that somebody meant. WORDS are the others.
    """
    commands = {
        name: {field: about._asdict() for field, about in fields_of(kind).items()}
        for name, kind in COMMANDS.items()
    }
    tables = {
        "MODES": MODE_NAMES,
        "STATES": {name: words.text for name, words in glossary.STATES.items()},
        "COMMANDS": commands,
        "ENDED": ENDED,
        "BY_A_PERSON": glossary.BY_A_PERSON,
        "WORDS": {name: getattr(glossary, name) for name in SHARED},
    }
    return "".join(
        f"export const {name} = {msgspec.json.encode(value).decode()};\n" for name, value in tables.items()
    )
