"""Recordings of a probe: MCAP files with the messages as they came and their schema inside.

They open in Foxglove. The format: https://mcap.dev, protobuf profile; one topic, `/lightprobe`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import IO, Any, Self

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from lightprobe_proto import lightprobe_pb2 as pb
from mcap.records import Chunk, McapRecord
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import Writer

from lightprobe.errors import LightprobeError

TOPIC = "/lightprobe"
SCHEMA = "lightprobe.v1.FromProbe"
#: A record, and what a compressed chunk unpacks to, may have so many bytes. Ours have some 16 KiB.
_MOST_BYTES = 16 << 20


class Recorder:
    """Writes messages as they come. What is written stays readable when the program is killed."""

    def __init__(self, path: Path) -> None:
        """`path` must not exist; raises OSError."""
        # Buffered: around a raw file the writer puts a buffer of its own, which it does not flush.
        self._file = open(path, "xb")  # noqa: SIM115 - closed by __exit__
        self._writer = Writer(self._file, chunk_size=16 * 1024)
        self._writer.start(profile="", library="lightprobe")
        schema = files("lightprobe_proto").joinpath("lightprobe.binpb").read_bytes()
        schema_id = self._writer.register_schema(SCHEMA, "protobuf", schema)
        self._channel = self._writer.register_channel(TOPIC, "protobuf", schema_id)
        self.messages = 0
        self._is_spoilt = False

    def __enter__(self) -> Self:
        """Nothing to do: it is open."""
        return self

    def __exit__(self, *_: object) -> None:
        """Write the index, and close; raises OSError where that cannot be written."""
        try:
            if not self._is_spoilt:
                self._writer.finish()  # type: ignore[no-untyped-call]
                self._file.flush()
        finally:
            with suppress(OSError):  # what is still in the buffer cannot be written either
                self._file.close()

    def write(self, payload: bytes, now_ns: int) -> None:
        """Add a FromProbe message that came at `now_ns` (Unix time).

        Raises OSError when it cannot be written; what was written before stays readable.
        """
        try:
            self._writer.add_message(self._channel, now_ns, payload, now_ns, self.messages)
            self._file.flush()
        except OSError:
            self._is_spoilt = True  # an index after half a record would be read as part of it
            raise
        self.messages += 1


class _TooLargeError(Exception):
    """A chunk that unpacks to more than any recording needs."""


def _unpacked(chunk: Chunk) -> bytes:
    """Content of a chunk; never takes more than the limit, whatever the chunk says of its size."""
    if chunk.compression == "zstd":
        data = zstandard.ZstdDecompressor(max_window_size=_MOST_BYTES).stream_reader(chunk.data)
        content = data.read(_MOST_BYTES + 1)
    elif chunk.compression == "lz4":
        content = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, _MOST_BYTES + 1)
    else:
        content = chunk.data
    if len(content) > _MOST_BYTES:
        raise _TooLargeError(f"a chunk unpacks to more than {_MOST_BYTES >> 20} MiB")
    return bytes(content)


def _records(file: IO[bytes]) -> Iterator[McapRecord]:
    """Every record, in the order of the file; those of one chunk at a time are in memory."""
    for record in StreamReader(file, emit_chunks=True, record_size_limit=_MOST_BYTES).records:
        if isinstance(record, Chunk):
            yield from breakup_chunk(replace(record, compression="", data=_unpacked(record)))
        else:
            yield record


@dataclass(frozen=True)
class Recorded:
    """One message of a recording."""

    time_ns: int  # when it came
    message: Any  # pb.FromProbe


def read(path: Path, notes: list[str]) -> Iterator[Recorded]:
    """Messages in the order of the file; what is cut off or spoilt goes to `notes`.

    Raises :class:`LightprobeError` for a file that is no recording, OSError.
    """
    count, foreign = 0, 0
    with open(path, "rb") as file:
        if file.read(8) != b"\x89MCAP0\r\n":
            raise LightprobeError(
                f"{path}: read: is no MCAP file: record one with `lightprobe record`"
            )
        file.seek(0)
        schemas: dict[int, str] = {}
        channels: dict[int, int] = {}
        try:
            for record in _records(file):
                kind = type(record).__name__
                if kind == "Schema":
                    schemas[record.id] = record.name  # type: ignore[attr-defined]
                elif kind == "Channel":
                    channels[record.id] = record.schema_id  # type: ignore[attr-defined]
                elif kind == "Message":
                    if schemas.get(channels[record.channel_id]) != SCHEMA:  # type: ignore[attr-defined]
                        foreign += 1
                        continue
                    message = pb.FromProbe.FromString(record.data)  # type: ignore[attr-defined]
                    count += 1
                    yield Recorded(record.log_time, message)  # type: ignore[attr-defined]
        except OSError:
            raise
        except Exception as error:  # MCAP, protobuf, zstd and lz4 raise a dozen kinds
            notes.append(
                f"{path}: is cut off after {count} messages ({str(error) or type(error).__name__})"
            )
    if foreign:
        notes.append(f"{path}: {foreign} messages of other programs are left out")
    if count == 0:
        raise LightprobeError(f"{path}: read: holds no message of a probe")
