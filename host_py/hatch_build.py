"""Build hook: pack proto/ as the Python package `lightprobe_proto`, generated under build/ alone.

A source distribution carries that package ready-made, so that installing one needs no protoc.
"""

from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

HERE = Path(__file__).resolve().parent
PROTO = HERE.parent / "proto"
GENERATED = HERE.parent / "build" / "gen" / "python" / "lightprobe_proto"
PACKED = HERE / "lightprobe_proto"  # only in a source distribution


class ProtoHook(BuildHookInterface):  # type: ignore[misc]
    """Compile the schema and add it to what is built: sdist, wheel, or editable wheel."""

    def dependencies(self) -> list[str]:
        """Name what brings protoc; nothing where the schema is compiled already."""
        return [] if PACKED.is_dir() else ["grpcio-tools"]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, copy the data schemas, and tell hatchling where they belong."""
        if not PACKED.is_dir():
            compile_schema()
        target = "force_include_editable" if version == "editable" else "force_include"
        source = PACKED if PACKED.is_dir() else GENERATED
        build_data[target] = {
            str(path): f"lightprobe_proto/{path.name}"
            for path in source.iterdir()
            if path.is_file()
        }
        if self.target_name == "sdist":  # in the repository a link, which would lead nowhere there
            build_data[target][str((HERE / "LICENSE").resolve())] = "LICENSE"


def compile_schema() -> None:
    """Run protoc (the one inside grpcio-tools) and copy what needs no compiling."""
    from grpc_tools import protoc

    GENERATED.mkdir(parents=True, exist_ok=True)
    for old in GENERATED.iterdir():
        if old.is_file():
            old.unlink()
    (GENERATED / "__init__.py").write_text('"""Packed from proto/."""\n')
    compiled = GENERATED / "lightprobe.binpb"
    schema = PROTO / "lightprobe.proto"
    status = protoc.main(["protoc", f"-I{PROTO}", f"--descriptor_set_out={compiled}", str(schema)])
    if status != 0:
        raise RuntimeError(f"proto: protoc ended with status {status}")
    modules = (HERE / "lightprobe_pb2.py", PROTO / "ranges.py")
    for path in (*modules, *PROTO.glob("*.dbc"), *PROTO.glob("*.toml")):
        (GENERATED / path.name).write_bytes(path.read_bytes())
