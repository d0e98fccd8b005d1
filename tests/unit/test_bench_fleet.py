"""The bench of a fleet: its table, and the dive that its vehicles repeat."""

import re

from rich.console import Console

from lab.operations.many_vehicles import SHOWN, Window, table


def test_the_table_has_the_ratio_of_all_vehicles_to_one() -> None:
    windows = [
        Window(
            vehicles,
            cpu=dict.fromkeys((*SHOWN, "all vehicles"), 0.02 * vehicles),
            memory_mb=dict.fromkeys(SHOWN, 40.0),
            delays_s=[0.001, 0.002, 0.003],
            samples=400 * vehicles,
            lost=7 * (vehicles - 1),
            seconds=1.0,
            load=3.0,
        )
        for vehicles in (1, 5)
    ]
    console = Console(record=True, width=100)
    console.print(table([(window.vehicles, window.bounds()) for window in windows]))
    rows = dict(
        re.split(r"  +", line.strip(), maxsplit=1) for line in console.export_text().splitlines()[4:-1]
    )
    assert rows["router: % of a core"].split() == ["2.0", "10.0", "5.0"]
    assert rows["age at a client: 50 % within, ms"].split() == ["2.00", "2.00", "1.0"]
    assert rows["samples a second"].split() == ["400", "2000", "5.0"]
    assert rows["samples lost"].split() == ["0", "28"]
