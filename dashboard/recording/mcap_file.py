"""One recording, an MCAP file: written so that a cut costs little, and read even when it was cut.

`log_time` is when the sample was true, `publish_time` when it was published, both in UTC nanoseconds.
"""

import os
import struct
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple, cast

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import CRCValidationError, breakup_chunk
from mcap.writer import CompressionType, Writer

from dashboard.recording.json_schema import schema_of

CHUNK_BYTES = 48_000
"""A chunk is closed when it is larger than this, and no sample has 16 kB: so no chunk has 64."""

COMPRESSION = "ZSTD"  # half the size of LZ4 on these samples, at the same cost
MAGIC = b"\x89MCAP0\r\n"
MAX_TIME_NS = 2**63 - 1
"""No sample is later: whoever computes with times does so in signed 64 bits."""

MAX_SAMPLE_BYTES = 1 << 20
MAX_ENCODING_BYTES = 255
"""Zenoh itself ends a process that publishes with a longer one."""
MAX_CHANNELS = 256
"""In a file: keys, each with its encoding."""

FREE_BYTES, MAX_RATIO = 16 << 20, 30
"""A file may unpack to this, and to so many times what was read of it: ours take six times."""

_HEAD = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<QQQII")
_BROKEN = (McapError, CRCValidationError, RuntimeError, zstandard.ZstdError, struct.error, ValueError)


class Item(NamedTuple):
    """One sample: its key and Zenoh encoding, the bytes, and its two times (UTC ns)."""

    key: str
    encoding: str
    payload: bytes
    log_ns: int
    publish_ns: int


def is_time(utc_ns: int) -> bool:
    """Tell whether a file can hold this time."""
    return 0 <= utc_ns <= MAX_TIME_NS


class TooManyChannelsError(ValueError):
    """A sample would need one channel too many."""


# --- Writing ----------------------------------------------------------------------------------------------


class Disk:
    """A new file without a buffer: what was written is the kernel's. Raises OSError, and FileExistsError."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("xb", buffering=0)
        self._size = self._safe = 0

    def write(self, data: bytes) -> int:
        """Write all of it."""
        rest = memoryview(data)
        while rest:
            written = self._file.write(rest) or 0
            self._size += written
            rest = rest[written:]
        return len(data)

    def tell(self) -> int:
        """Return how much was written."""
        return self._size

    def flush(self) -> None:
        """Do nothing: there is no buffer."""

    def sync(self) -> None:
        """Put all on the disk."""
        os.fdatasync(self._file.fileno())
        self._safe = self._size

    def give_up(self) -> None:
        """Close after an error; keep what was on the disk at the last `sync`."""
        self._file.truncate(self._safe)
        self._file.close()

    def close(self) -> None:
        """Put all on the disk and close."""
        self.sync()
        self._file.close()


class Recording:
    """A file being written. Everything raises OSError when the disk fails: then `give_up`."""

    def __init__(
        self, path: Path, disk: Disk | None = None, reserved: Collection[tuple[str, str]] = ()
    ) -> None:
        """`reserved` are keys with their encodings that get a channel even when `MAX_CHANNELS` are taken."""
        self.path = path
        self.messages = 0
        self._reserved = reserved
        self._disk = disk or Disk(path)
        self._writer = Writer(
            cast(BinaryIO, self._disk), chunk_size=CHUNK_BYTES, compression=CompressionType[COMPRESSION]
        )
        try:
            self._writer.start(profile="", library="holdfast")
        except OSError:
            self._disk.give_up()
            raise
        self._channels: dict[tuple[str, str], int] = {}
        self._schemas: dict[tuple[str, bytes], int] = {}

    @property
    def size_bytes(self) -> int:
        """How large the file is by now."""
        return self._disk.tell()

    def add(self, item: Item) -> None:
        """Write a sample, under a schema of its own where it is JSON.

        Raises ValueError, and leaves the file as it is, for a sample that no recording holds.
        """
        if not (is_time(item.log_ns) and is_time(item.publish_ns)):
            raise ValueError("a time that cannot be")
        if len(item.payload) > MAX_SAMPLE_BYTES or len(item.encoding.encode()) > MAX_ENCODING_BYTES:
            raise ValueError("too large")
        channel = self._channels.get((item.key, item.encoding)) or self._channel(item)
        self.messages += 1
        self._writer.add_message(channel, item.log_ns, item.payload, item.publish_ns, self.messages)

    def describe(self, name: str, table: Mapping[str, str]) -> None:
        """Write a table about the recording."""
        self._writer.add_metadata(name, dict(table))

    def sync(self) -> None:
        """Close the chunk and put it on the disk."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._disk.sync()

    def close(self) -> None:
        """Write summary and index, and close."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._disk.close()

    def give_up(self) -> None:
        """Close as it is after an OSError: readable up to the last `sync`."""
        self._disk.give_up()

    def _channel(self, item: Item) -> int:
        if len(self._channels) >= MAX_CHANNELS and (item.key, item.encoding) not in self._reserved:
            raise TooManyChannelsError(f"of more than {MAX_CHANNELS} keys the others are left out")
        item.key.encode()
        try:
            schema = schema_of(item.encoding, item.payload)
        except ValueError:
            schema = None
        written = item.encoding.partition(";")[0].rpartition("/")[2] or "bytes"
        encoding = "json" if schema and "json" in item.encoding else written
        number = 0
        if schema:
            number = self._schemas.get(schema) or self._writer.register_schema(
                schema[0], "jsonschema", schema[1]
            )
            self._schemas[schema] = number
        channel = self._writer.register_channel(item.key, encoding, number, {"zenoh": item.encoding})
        self._channels[item.key, item.encoding] = channel
        return channel


# --- Reading ----------------------------------------------------------------------------------------------


@dataclass
class Reader:
    """A recording, whole or cut. Iterate over its samples, in the order in which they were written.

    What was found on the way stands in the attributes, complete after the last sample: `metadata` by name (of
    several tables with one name the first), `whole` if the file ends as it should, `broken_chunks` that did
    not fit their checksum or would unpack to more than a recording does, and `lost_bytes` at the end that
    nothing could be made of.
    Raises ValueError for what is no MCAP file at all, OSError for what cannot be read.
    """

    path: Path
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    whole: bool = False
    broken_chunks: int = 0
    lost_bytes: int = 0
    unpacked_bytes: int = 0

    def __iter__(self) -> Iterator[Item]:
        """Read from the start."""
        self.metadata, self.whole, self.broken_chunks, self.lost_bytes = {}, False, 0, 0
        self.unpacked_bytes = 0
        channels: dict[int, Channel] = {}
        with self.path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise ValueError(f"{self.path}: is no MCAP file")
            for record in self._records(file):
                if isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Metadata):
                    self.metadata.setdefault(record.name, record.metadata)
                elif (
                    isinstance(record, Message)
                    and record.channel_id in channels
                    and max(record.log_time, record.publish_time) <= MAX_TIME_NS
                ):
                    channel = channels[record.channel_id]
                    encoding = channel.metadata.get("zenoh", f"application/{channel.message_encoding}")
                    yield Item(channel.topic, encoding, record.data, record.log_time, record.publish_time)

    def _records(self, file: BinaryIO) -> Iterator[McapRecord]:
        while True:
            head = file.read(_HEAD.size)
            if len(head) < _HEAD.size:
                self.lost_bytes = len(head)
                return
            opcode, length = _HEAD.unpack(head)
            if not opcode:  # a file system that lost power leaves zeros
                self.lost_bytes = self.path.stat().st_size - file.tell() + _HEAD.size
                return
            if opcode == Opcode.DATA_END:
                self.whole = file.seek(-len(MAGIC), os.SEEK_END) > 0 and file.read() == MAGIC
                return
            body = file.read(min(length, 2**31))
            if len(body) < length:
                self.lost_bytes = _HEAD.size + len(body)
                yield from self._rest(opcode, body, file.tell())
                return
            yield from self._whole(opcode, body, file.tell())

    def _whole(self, opcode: int, body: bytes, read_bytes: int) -> list[McapRecord]:
        stream = ReadDataStream(BytesIO(body))
        try:
            if opcode == Opcode.CHUNK:
                chunk = Chunk.read(stream)
                self._admit(chunk.uncompressed_size, read_bytes)
                if chunk.compression == "zstd":
                    data = _unpacked(chunk.data, chunk.uncompressed_size)
                    chunk = replace(chunk, compression="", data=data)
                return breakup_chunk(chunk, validate_crc=True)
            if opcode == Opcode.METADATA:
                return [Metadata.read(stream)]
        except _BROKEN:
            self.broken_chunks += opcode == Opcode.CHUNK
        return []

    def _admit(self, size: int, read_bytes: int) -> None:
        """Count a chunk that unpacks to `size`; raise ValueError where that is more than a recording has."""
        self.unpacked_bytes += size
        if self.unpacked_bytes > FREE_BYTES + MAX_RATIO * read_bytes:
            self.unpacked_bytes -= size
            raise ValueError("a chunk unpacks to more than a recording has")

    def _rest(self, opcode: int, body: bytes, read_bytes: int) -> Iterator[McapRecord]:
        """Give the whole samples at the beginning of a cut chunk: few, for it is compressed as one block."""
        if opcode != Opcode.CHUNK or len(body) < _CHUNK_HEAD.size:
            return
        *_, size, _, name_bytes = _CHUNK_HEAD.unpack_from(body)
        name_end = _CHUNK_HEAD.size + name_bytes
        compression, data = body[_CHUNK_HEAD.size : name_end], body[name_end + 8 :]
        if compression == b"zstd":
            with suppress(ValueError, zstandard.ZstdError):
                self._admit(size, read_bytes)
                data = _unpacked(data, size)
        at = 0
        while at + _HEAD.size <= len(data):
            opcode, length = _HEAD.unpack_from(data, at)
            at += _HEAD.size
            if at + length > len(data):
                return
            stream = ReadDataStream(BytesIO(data[at : at + length]))
            at += length
            if opcode == Opcode.CHANNEL:
                yield Channel.read(stream)
            elif opcode == Opcode.SCHEMA:
                yield Schema.read(stream)
            elif opcode == Opcode.MESSAGE:
                yield Message.read(stream, length)


def _unpacked(data: bytes, size: int) -> bytes:
    """Return what zstd made `data` of, all that can be had of it, `size` bytes at most."""
    with zstandard.ZstdDecompressor().stream_reader(data) as reader:
        return reader.read(size)
