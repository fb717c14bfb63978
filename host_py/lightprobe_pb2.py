"""Messages of proto/lightprobe.proto, made by whichever protobuf runtime is at hand.

The build hook packs this file as `lightprobe_proto.lightprobe_pb2`, beside the schema in its
compiled form. Code that protoc generates refuses runtimes that are older than itself, or more than
one major version newer; a descriptor and the runtime's public functions have no such bounds.
"""

from __future__ import annotations

from importlib.resources import files
from typing import Any

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClassesForFiles

_PACKAGE = "lightprobe.v1"


def _messages() -> dict[str, Any]:
    """Message classes by full name."""
    compiled = files(__package__).joinpath("lightprobe.binpb").read_bytes()
    schema, pool = FileDescriptorSet.FromString(compiled), DescriptorPool()
    for file in schema.file:
        pool.Add(file)
    return GetMessageClassesForFiles([file.name for file in schema.file], pool)


_CLASSES = _messages()


def __getattr__(name: str) -> Any:
    """Class of a top-level message; enumerations are reached through the message they are in."""
    try:
        return _CLASSES[f"{_PACKAGE}.{name}"]
    except KeyError:
        raise AttributeError(f"lightprobe_proto has no message {name!r}") from None
