"""The schema compiles for the languages that protoc knows, with names of its own in each."""

import re
import subprocess
from pathlib import Path

import pytest
from lightprobe_proto import lightprobe_pb2 as pb

PROTO = Path(__file__).resolve().parents[3] / "proto"


def generated(tmp_path, language):
    """Names and text of the files that protoc writes."""
    command = ["protoc", f"-I{PROTO}", f"--{language}_out={tmp_path}", "lightprobe.proto"]
    subprocess.run(command, check=True)
    files = (file for file in tmp_path.rglob("*") if file.is_file())
    return {str(file.relative_to(tmp_path)): file.read_text(errors="replace") for file in files}


@pytest.mark.parametrize(
    ("language", "file", "words"),
    [
        ("java", "lightprobe/v1/Estimate.java", "package lightprobe.v1;"),
        ("kotlin", "lightprobe/v1/EstimateKt.kt", "package lightprobe.v1"),
        ("csharp", "Lightprobe.cs", "namespace Lightprobe.V1 {"),
        ("objc", "Lightprobe.pbobjc.h", "@interface LPBEstimate : GPBMessage"),
        ("php", "Lightprobe/V1/Estimate.php", "namespace Lightprobe\\V1;"),
        ("ruby", "lightprobe_pb.rb", "module Lightprobe\n  module V1"),
        ("cpp", "lightprobe.pb.h", "namespace lightprobe {\nnamespace v1 {"),
    ],
)
def test_protoc_writes_it_under_our_names(tmp_path, language, file, words):
    files = generated(tmp_path, language)
    assert file in files
    assert words in files[file]


def test_go_and_swift_have_names():
    """Their plugins are not part of protoc. Go's refuses a schema without an import path."""
    options = pb.Estimate.DESCRIPTOR.file.GetOptions()
    path, _, package = options.go_package.partition(";")
    assert re.fullmatch(r"[a-z]+(/[a-z0-9]+)+", path)
    assert re.fullmatch(r"[a-z][a-z0-9]*", package)
    assert options.swift_prefix == "Lightprobe_"
