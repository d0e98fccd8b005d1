"""One recording, an MCAP file: written so that a cut costs little, and read even when it was cut.

`log_time` is when the sample was true, `publish_time` when it was published, both in UTC nanoseconds.
"""

import errno
import os
import struct
import zlib
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

import lz4.frame
import msgspec
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Metadata
from mcap.writer import CompressionType, Writer

from companion.telemetry import schemas as telemetry
from holdfast.files import refuse_endless

CHUNK_BYTES = 48_000
"""A chunk is closed when it is larger than this, and no sample has 16 kB: so no chunk has 64."""

COMPRESSION = "ZSTD"  # half the size of LZ4 on these samples, at the same cost
MAGIC = b"\x89MCAP0\r\n"
MAX_TIME_NS = 2**63 - 1
"""No sample is later: whoever computes with times does so in signed 64 bits."""

MAX_SAMPLE_BYTES = 1 << 20  # telemetry.session drops larger messages
MAX_ENCODING_BYTES = 255
"""Zenoh itself ends a process that publishes with a longer one."""
MAX_CHANNELS = 256
"""Largest number of keys in a file, each with its encoding."""
FREE_BYTES, MAX_RATIO = 16 << 20, 30
"""A file may unpack to this, and to so many times what was read of it: ours take six times."""
MAX_RECORD_BYTES = 1 << 23
"""Largest record, packed or not: chunks of other writers have up to half of it."""
MAX_KEY_CHARS, MAX_TABLES = 4096, 64
"""Longer keys, and further tables about the recording, are passed over."""

_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_BROKEN = (McapError, RuntimeError, zstandard.ZstdError, struct.error, ValueError, OverflowError)


class Item(NamedTuple):
    """One sample: its key and Zenoh encoding, the bytes, and its two times (UTC ns)."""

    key: str
    encoding: str
    payload: bytes
    log_ns: int
    publish_ns: int


def schema_of(encoding: str) -> tuple[str, bytes] | None:
    """Return name and JSON Schema of the record of ours that an encoding names; None for another one.

    Foxglove and Lichtblick want an object at the root, and a type in every field. `Raw` is no JSON:
    they do not show it.
    """
    name = encoding.partition(";")[2]
    record = getattr(telemetry, name.rpartition(".v")[0].rpartition(".")[2], None)
    if not (isinstance(record, type) and issubclass(record, msgspec.Struct)):
        return None
    _, parts = msgspec.json.schema_components([record])
    root = parts.pop(record.__name__)
    return name, msgspec.json.encode(root | ({"$defs": parts} if parts else {}))


# --- Writing ----------------------------------------------------------------------------------------------


class Recording:
    """A file being written. Everything raises OSError when the disk fails: then `give_up`."""

    def __init__(self, path: Path, reserved: Collection[tuple[str, str]] = ()) -> None:
        """`reserved` are keys with their encodings that get a channel even when `MAX_CHANNELS` are taken."""
        self.path = path
        self.messages = 0
        self._reserved = reserved
        self._file = path.open("xb")
        self._safe = 0  # bytes that are on the disk, once there are samples among them
        self.writer = Writer(self._file, chunk_size=CHUNK_BYTES, compression=CompressionType[COMPRESSION])
        self.writer.start(profile="", library="holdfast")
        self._channels: dict[tuple[str, str], int] = {}
        self._schemas: dict[str, int] = {}

    @property
    def size_bytes(self) -> int:
        """How large the file is by now."""
        return self._file.tell()

    def add(self, item: Item) -> None:
        """Write a sample, under its schema where it is one of ours.

        Raises ValueError, and leaves the file as it is, for a sample that no recording holds.
        """
        if not all(0 <= utc_ns <= MAX_TIME_NS for utc_ns in (item.log_ns, item.publish_ns)):
            raise ValueError("a time that cannot be")
        if len(item.payload) > MAX_SAMPLE_BYTES or len(item.encoding.encode()) > MAX_ENCODING_BYTES:
            raise ValueError("too large")
        channel = self._channels.get((item.key, item.encoding)) or self._channel(item)
        self.messages += 1
        self.writer.add_message(channel, item.log_ns, item.payload, item.publish_ns, self.messages)

    def describe(self, name: str, table: Mapping[str, str]) -> None:
        """Write a table about the recording."""
        self.writer.add_metadata(name, dict(table))

    def sync(self) -> None:
        """Close the chunk and put it on the disk, if the file is still there."""
        self.writer.flush()  # type: ignore[no-untyped-call]
        os.fdatasync(self._file.fileno())
        if not os.fstat(self._file.fileno()).st_nlink:
            raise FileNotFoundError(errno.ENOENT, "somebody deleted it", str(self.path))
        self._safe = self._file.tell() if self.messages else 0

    def close(self) -> None:
        """Write summary and index, and close."""
        self.writer.finish()  # type: ignore[no-untyped-call]
        self._file.flush()
        os.fdatasync(self._file.fileno())
        self._file.close()

    def give_up(self) -> bool:
        """Close as it is after an OSError: readable up to the last `sync`; tell whether anything is."""
        with suppress(OSError):
            self._file.close()
        if self._safe:
            os.truncate(self.path, self._safe)
        else:
            self.path.unlink()
        return self._safe > 0

    def _channel(self, item: Item) -> int:
        if len(self._channels) >= MAX_CHANNELS and (item.key, item.encoding) not in self._reserved:
            raise ValueError(f"of more than {MAX_CHANNELS} keys the others are left out")
        item.key.encode()
        encoding = item.encoding.partition(";")[0].rpartition("/")[2] or "bytes"
        number = 0
        if schema := schema_of(item.encoding):
            name, text = schema
            number = self._schemas.get(name) or self.writer.register_schema(name, "jsonschema", text)
            self._schemas[name] = number
        channel = self.writer.register_channel(item.key, encoding, number, {"zenoh": item.encoding})
        self._channels[item.key, item.encoding] = channel
        return channel


# --- Reading ----------------------------------------------------------------------------------------------


@dataclass
class Reader:
    """A recording, whole or cut. Iterate over its samples, in the order in which they were written.

    The attributes are complete after the last sample. Raises ValueError for what is no MCAP file at all, and
    for one of which no sample can be read; OSError for what cannot be read.
    """

    path: Path
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    """Tables by name; of several with one name the first."""
    whole: bool = False
    """The file ends as it should."""
    broken_chunks: int = 0
    """That did not fit their checksum, or are larger than a recording has."""
    lost_bytes: int = 0
    """At the end, of which nothing could be made."""
    unpacked_bytes: int = 0

    def __iter__(self) -> Iterator[Item]:
        """Read from the start."""
        self.metadata, self.whole, self.broken_chunks, self.lost_bytes = {}, False, 0, 0
        self.unpacked_bytes = count = 0
        channels: dict[int, tuple[str, str]] = {}
        refuse_endless(self.path)
        with self.path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise ValueError(f"{self.path}: is no MCAP file")
            for opcode, body in self._records(file):
                try:
                    if opcode == Opcode.MESSAGE:
                        number, _, log_ns, publish_ns = _MESSAGE.unpack_from(body)
                        if number in channels and max(log_ns, publish_ns) <= MAX_TIME_NS:
                            count += 1
                            yield Item(*channels[number], body[_MESSAGE.size :], log_ns, publish_ns)
                    elif opcode == Opcode.CHANNEL:
                        channel = Channel.read(ReadDataStream(BytesIO(body)))
                        encoding = channel.metadata.get("zenoh", f"application/{channel.message_encoding}")
                        if len(channel.topic) <= MAX_KEY_CHARS and len(encoding) <= MAX_ENCODING_BYTES:
                            channels[channel.id] = channel.topic, encoding
                    elif opcode == Opcode.METADATA and len(self.metadata) < MAX_TABLES:
                        table = Metadata.read(ReadDataStream(BytesIO(body)))
                        self.metadata.setdefault(table.name, table.metadata)
                except _BROKEN:
                    continue
        if not count and (self.broken_chunks or not self.whole):
            raise ValueError(f"{self.path}: no sample in it can be read: take another copy of it")

    def _records(self, file: BinaryIO) -> Iterator[tuple[int, bytes]]:
        """Give each record outside and inside of chunks, as its opcode and its bytes.

        A file that is still written is read as far as it went at the start.
        """
        size = os.fstat(file.fileno()).st_size
        while (left := size - file.tell()) >= _HEAD.size:
            opcode, length = _HEAD.unpack(file.read(_HEAD.size))
            if opcode == Opcode.DATA_END:
                self.whole = file.seek(-len(MAGIC), os.SEEK_END) > 0 and file.read() == MAGIC
                return
            if not opcode or length > left - _HEAD.size:  # a file system that lost power leaves zeros
                break
            if length > MAX_RECORD_BYTES:
                file.seek(length, os.SEEK_CUR)
                self.broken_chunks += opcode == Opcode.CHUNK
                continue
            body = file.read(length)
            if opcode == Opcode.CHUNK:
                yield from self._inside(body, file.tell())
            else:
                yield opcode, body
        self.lost_bytes = left

    def _inside(self, body: bytes, read_bytes: int) -> Iterator[tuple[int, bytes]]:
        """Give the records of a chunk; of one that unpacks to more than a recording has, none."""
        try:
            chunk = Chunk.read(ReadDataStream(BytesIO(body)))
            data = chunk.data
            if chunk.compression:
                admitted = FREE_BYTES + MAX_RATIO * read_bytes - self.unpacked_bytes
                if chunk.uncompressed_size > min(admitted, MAX_RECORD_BYTES):
                    raise ValueError("too large")
                self.unpacked_bytes += chunk.uncompressed_size
                data = _unpacked(chunk)
            if len(data) != chunk.uncompressed_size or chunk.uncompressed_crc not in (0, zlib.crc32(data)):
                raise ValueError("not what was packed")
        except _BROKEN:
            self.broken_chunks += 1
            return
        at = 0
        while at + _HEAD.size <= len(data):
            opcode, length = _HEAD.unpack_from(data, at)
            at += _HEAD.size
            if at + length > len(data):
                return
            yield opcode, data[at : at + length]
            at += length


def _unpacked(chunk: Chunk) -> bytes:
    """Return what was packed, as many bytes as the chunk says at most."""
    size = chunk.uncompressed_size
    if chunk.compression == "zstd":
        unpacker = zstandard.ZstdDecompressor(max_window_size=MAX_RECORD_BYTES)
        with unpacker.stream_reader(chunk.data) as reader:
            return reader.read(size)
    if chunk.compression == "lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size))
    raise ValueError(f"unknown compression {chunk.compression!r}")
