"""The extension's Dockerfile says what BlueOS reads of an image: its labels."""

import json
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "blueos" / "Dockerfile").read_text()
QUOTED = {
    name: (quote, value)
    for name, quote, value in re.findall(
        r"""^LABEL (\w+)=(["'])(.*)\2$""", TEXT.replace("\\\n", ""), flags=re.MULTILINE
    )
}
LABELS = {name: value.replace(r"\"", '"') for name, (_, value) in QUOTED.items()}


def test_what_should_be_json_is_json_and_what_the_store_takes():
    kinds = {"permissions": dict, "authors": list, "company": dict, "links": dict, "tags": list}
    assert all(isinstance(json.loads(LABELS[label]), kind) for label, kind in kinds.items())
    assert LABELS["type"] in ("device-integration", "example", "theme", "other", "tool", "education")
    tags = json.loads(LABELS["tags"])
    assert len(tags) <= 10
    assert all(re.fullmatch(r"[a-z0-9-]+", tag) for tag in tags)


def test_a_variable_of_a_label_is_put_in():
    """Nothing is put in within single quotes: the image that was built had `$OWNER` in a link."""
    assert LABELS.keys() == set(re.findall(r"^LABEL (\w+)", TEXT, flags=re.MULTILINE))
    assert {quote for quote, value in QUOTED.values() if "$" in value} == {'"'}
    given = set(re.findall(r"^ARG (\w+)", TEXT.rpartition("\nFROM ")[2], flags=re.MULTILINE))
    assert given == set(re.findall(r"\$(\w+)", "".join(LABELS.values())))


def test_the_page_and_the_volume_are_those_of_the_program():
    permissions, host = (found := json.loads(LABELS["permissions"])), found["HostConfig"]
    port = re.findall(r"^PORT = (\d+)", (ROOT / "blueos" / "start.py").read_text(), flags=re.MULTILINE)[0]
    assert [*permissions["ExposedPorts"]] == [*host["PortBindings"]] == [f"{port}/tcp"]
    assert [bind.partition(":")[2] for bind in host["Binds"]] == ["/data"]
    assert "host.docker.internal:host-gateway" in host["ExtraHosts"]


def test_the_image_gets_what_the_dockerfile_copies_and_nothing_else():
    lines = re.findall(r"^COPY (?!--from)(.+) \S+$", TEXT, flags=re.MULTILINE)
    copied = {name for line in lines for name in line.split()}
    ignored = (ROOT / "blueos" / "Dockerfile.dockerignore").read_text().split()
    assert ignored[0] == "*"
    assert {f"!{name}" for name in copied} == set(ignored[1:])
