"""One table, however a program or a spreadsheet saved it."""

import numpy as np
import pytest
from dive_logs import dive, write_csv

from companion.identify.sample_table import NoDiveError
from lab.identify.readers import read

FRAME = "vectored_6dof"


def times(text, count):
    """Write the times (s) of a table as `count` makes them."""
    head, *lines = text.splitlines()
    rows = (line.partition(",") for line in lines)
    return "\n".join([head, *(f"{count(float(t_s))},{rest}" for t_s, _, rest in rows)])


SAVED = {
    "byte order mark": lambda text: ("\ufeff" + text).encode(),
    "UTF-16": lambda text: text.encode("utf-16"),
    "Windows": lambda text: text.replace("\n", "\r\n").encode(),
    "semicolons": lambda text: text.replace(",", ";").encode(),
    "decimal commas": lambda text: text.replace(",", ";").replace(".", ",").encode(),
    "tabs and decimal commas": lambda text: text.replace(",", "\t").replace(".", ",").encode(),
    "spaces": lambda text: text.replace(",", " , ").encode(),
    "spaces alone": lambda text: (
        text.replace(",,", ",nan,").replace(",,", ",nan,").replace(",", " ").encode()
    ),
    "quotes": lambda text: "\n".join(
        '"' + line.replace(",", '","') + '"' for line in text.splitlines()
    ).encode(),
    "a separator's line": lambda text: ("sep=;\r\n" + text.replace(",", ";")).encode("utf-16"),
    "comments": lambda text: ("# Becken, 20 °C\n\n# t: s\n" + text).encode("cp1252"),
    "capitals": lambda text: (text.partition("\n")[0].upper() + "\n" + text.partition("\n")[2]).encode(),
    "Unix seconds": lambda text: times(text, lambda t_s: f"{t_s + 1.7e9:.3f}").encode(),
    "Unix milliseconds": lambda text: times(text, lambda t_s: round(1e3 * t_s + 1.7e12)).encode(),
    "milliseconds": lambda text: times(text, lambda t_s: round(1e3 * t_s)).encode(),
    "microseconds": lambda text: times(text, lambda t_s: round(1e6 * t_s)).encode(),
    "Unix nanoseconds": lambda text: times(text, lambda t_s: round(1e9 * t_s + 1.7e18)).encode(),
}


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return write_csv(dive(12.0), tmp_path_factory.mktemp("dive") / "plain.csv")


@pytest.mark.parametrize("saved", SAVED)
def test_it_is_the_same_table(saved, plain, tmp_path):
    other = tmp_path / "other.csv"
    other.write_bytes(SAVED[saved](plain.read_text(encoding="utf-8")))
    expected, table = read(plain, FRAME), read(other, FRAME)
    np.testing.assert_allclose(table.command_s, expected.command_s, atol=1e-5)
    np.testing.assert_allclose(table.commands, expected.commands)
    np.testing.assert_allclose(table.velocity, expected.velocity, atol=1e-5)
    assert any("counts" in note for note in table.notes) is ("Unix s" not in saved and "seconds" in saved)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("time;surge;z_m\n0;0;1\n", "it begins with: time;surge;z_m"),
        ("t_s,depth\n0,1\n1,1\n", "its header is: t_s,depth"),
        ("t_s,surge,z_m\n" + "0,0.1,1\n10,0.1,1\n" * 50, "49 rows whose t_s is before the row above"),
    ],
)
def test_a_refusal_quotes_what_was_found(text, says, tmp_path):
    file = tmp_path / "dive.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(NoDiveError, match=says):
        read(file, FRAME)
