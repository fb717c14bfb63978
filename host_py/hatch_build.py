"""Build hook: turn proto/ into the Python package `lightprobe_proto`, under build/ alone."""

from pathlib import Path
from typing import Any

from grpc_tools import protoc
from hatchling.builders.hooks.plugin.interface import BuildHookInterface

ROOT = Path(__file__).resolve().parent.parent
PROTO = ROOT / "proto"
GENERATED = ROOT / "build" / "gen" / "python" / "lightprobe_proto"


class ProtoHook(BuildHookInterface):  # type: ignore[misc]
    """Generate the schema modules and add them to the wheel, editable or not."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Run protoc (the one inside grpcio-tools) and copy the data schemas."""
        GENERATED.mkdir(parents=True, exist_ok=True)
        (GENERATED / "__init__.py").write_text('"""Generated from proto/."""\n')
        status = protoc.main(
            [
                "protoc",
                f"-I{PROTO}",
                f"--python_out={GENERATED}",
                f"--pyi_out={GENERATED}",
                str(PROTO / "lightprobe.proto"),
            ]
        )
        if status != 0:
            raise RuntimeError(f"proto: protoc ended with status {status}")
        for schema in [*PROTO.glob("*.dbc"), *PROTO.glob("*.toml")]:
            (GENERATED / schema.name).write_bytes(schema.read_bytes())
        target = "force_include_editable" if version == "editable" else "force_include"
        build_data[target] = {
            str(path): f"lightprobe_proto/{path.name}"
            for path in GENERATED.iterdir()
            if path.is_file()
        }
