"""docs/telemetry.md and the JSON Schemas say what the code does."""

import json
from pathlib import Path

import msgspec

from companion.telemetry import schemas as telemetry
from lab import documents as schema
from lab import results_page
from lab.commands import schema as command
from lab.measured_sources import measured_code
from lab.study import provenance
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.sim_config import load_config
from sim_bridge.vehicle import Vehicle
from sim_bridge.zenoh_link import SCHEMA, encode


def test_the_pages_are_not_stale() -> None:
    for name, made in schema.pages().items():
        _, mark, generated = (schema.DOCS / name).read_text(encoding="utf-8").partition(schema.MARK)
        assert mark
        assert generated == made, f"{name} is stale: run `holdfast lab schema --write`"


def test_json_schemas_are_written_where_they_are_asked_for(tmp_path: Path) -> None:
    assert command(["--json", str(tmp_path / "new")]) == 0
    assert {path.name: path.read_bytes() for path in (tmp_path / "new").iterdir()} == schema.schemas()


def test_the_tables_of_the_pages_are_those_of_their_files() -> None:
    written = results_page.PAGE.read_text(encoding="utf-8")
    assert written == results_page.filled(written), "results.md is stale: run `holdfast lab schema --write`"
    shown = {name for _, _, name, _ in results_page.MARKED.findall(written)}
    assert shown >= {path.stem for path in results_page.FOLDER.glob("*.json")}


def test_the_readme_says_what_the_tables_say() -> None:
    """The SD on the real ArduSub: Holdfast's mean, ALT_HOLD's range; results.md repeats the first."""
    content = json.loads((results_page.FOLDER / "firmware.json").read_text(encoding="utf-8"))
    ours, stock, tuned = ([float(cell.split()[0]) for cell in row[1:]] for row in content["rows"])
    readme = " ".join((schema.DOCS.parent / "README.md").read_text(encoding="utf-8").split())
    assert f"varies by about {sum(ours) / len(ours):.0f} mm (SD)" in readme
    for kind, figures in (("tuned", tuned), ("default", stock)):
        assert f"by {min(figures):.0f} to {max(figures):.0f} mm with {kind} gains" in readme
    results = results_page.PAGE.read_text(encoding="utf-8")
    assert f"about {sum(ours) / len(ours):.0f} mm (SD)" in results


def test_a_table_says_whether_what_decides_a_dive_has_changed(tmp_path: Path) -> None:
    source, field = tmp_path / "companion/core/law.py", tmp_path / "companion/telemetry/schemas.py"
    for file in (source, field):
        file.parent.mkdir(parents=True)
        file.write_text("KAPPA = 3.5\n", encoding="utf-8")
    measured = provenance("holdfast lab bench reality") | {"code": measured_code(tmp_path)}
    field.write_text("KAPPA = 3.5\nSALINITY = 35.0\n", encoding="utf-8")
    for line, said in (
        ('"""The law."""\nKAPPA  = 3.5  # per second\n', "same code"),
        ("KAPPA = 4.0\n", "**older code**"),
    ):
        source.write_text(line, encoding="utf-8")
        assert results_page.age(measured, measured_code(tmp_path)) == said


def test_a_stamp_is_made_at_a_release_and_goes_with_the_table_that_it_is_of() -> None:
    name = sorted(results_page.FOLDER.glob("*.json"))[0].stem
    line = results_page.made(json.loads((results_page.FOLDER / f"{name}.json").read_text())["provenance"])
    for old, kept in ((f"{line}, 1.0.0: same code", True), (f"{line[:-1]}x, 1.0.0: same code", False)):
        page = f"<!--made:{name}-->\n\n{old}\n\n<!--end-->\n"
        assert (old in results_page.filled(page)) is kept
        assert f"{line}\n" in results_page.filled(page) or kept
        assert f"{line}, 1.0.0: " in results_page.filled(page, stamp=True)


def test_every_python_makes_the_same_digest_of_the_code(tmp_path: Path) -> None:
    source = tmp_path / "companion" / "law.py"
    source.parent.mkdir()
    text = 'def say(z_m: float) -> str:\n    """Say it."""\n    # aloud\n    return f"{z_m:.1f} m"  # so\n'
    source.write_text(text, encoding="utf-8")
    assert measured_code(tmp_path) == "fbe3a15dcc2ad0ef"
    source.write_text(text.replace("so", "and so on").replace("Say it", "Say\n\n    # it"), encoding="utf-8")
    assert measured_code(tmp_path) == "fbe3a15dcc2ad0ef"


def test_every_field_that_is_published_is_described() -> None:
    for record in {*telemetry.EVERY_TICK.values(), *telemetry.NOW_AND_THEN.values(), telemetry.Reply}:
        fields = json.loads(schema.schemas()[f"{record.__name__}.json"])["$defs"][record.__name__]
        assert set(fields["properties"]) == set(record.__struct_fields__)
        for name, field in fields["properties"].items():
            assert field.get("description"), f"{record.__name__}.{name}"


def test_what_the_simulator_publishes_follows_our_schema_of_it() -> None:
    truth = Vehicle(load_config(DEFAULT_CONFIG), 1).truth()
    msgspec.json.decode(encode(truth), type=telemetry.Truth)
    assert json.loads(encode(truth)).keys() == set(telemetry.Truth.__struct_fields__)
    assert telemetry.TRUTH_ENCODING == SCHEMA
