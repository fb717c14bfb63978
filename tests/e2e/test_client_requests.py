"""What a client asks a probe for, scripted: maps of polarized light, sweeps, stills."""

import numpy as np
import pytest
from lightprobe import wire
from lightprobe.client import Client
from lightprobe.errors import ProbeError, ProbeTimeout
from lightprobe_proto import lightprobe_pb2 as pb
from scripted_probe import LONG_S, Probe, hello, polarized, serve


def test_maps_of_polarized_light_and_sweeps_on_request():
    with Probe(polarized(sweeps=7)) as probe, Client(probe.uri) as client:
        assert client.sweep(LONG_S) == 7
        found = client.polarization(LONG_S)
        assert found.sweeps == 7
        np.testing.assert_allclose(found.s0, [[1, np.nan]])
        np.testing.assert_allclose([found.q[0, 0], found.u[0, 0]], [0.3, -0.4], atol=1e-3)


def test_stills_on_request():
    with Probe(polarized()) as probe, Client(probe.uri) as client:
        assert client.take_stills(LONG_S) == 1
    with Probe(polarized(minor=4)) as probe, Client(probe.uri) as client:
        with pytest.raises(ProbeError, match=r"older than protocol 1\.5"):
            client.take_stills(LONG_S)
        assert client.sweep(LONG_S) == 0


def test_what_the_probe_refuses_is_said():
    with Probe(polarized(refuse="start it with --so")) as probe, Client(probe.uri) as client:
        with pytest.raises(ProbeError, match="start it with --so"):
            client.polarization(LONG_S)
        with pytest.raises(ProbeError, match="start it with --so"):
            client.sweep(LONG_S)
        assert client.receive(LONG_S)


def test_a_probe_that_knows_no_maps_and_one_that_does_not_answer():
    with (
        Probe(serve(hello(minor=3))) as probe,
        Client(probe.uri) as client,
        pytest.raises(ProbeError, match=r"older than protocol 1\.4"),
    ):
        client.polarization(LONG_S)
    with (
        Probe(serve(hello(minor=4))) as probe,
        Client(probe.uri) as client,
        pytest.raises(ProbeTimeout, match="for an answer"),
    ):
        client.polarization(0.5)


@pytest.mark.parametrize("fault", [{"width": 3}, {"s0_unit": 0.0}, {"cells": b"\x00\x7c" * 8}])
def test_maps_that_cannot_be_are_refused(fault):
    good = {"width": 2, "height": 1, "s0_unit": 1.0, "cells": bytes(16)}
    wire.decode(pb.FromProbe(polarization_map=good).SerializeToString())
    with pytest.raises(wire.WireError, match=r"(?i)polarization ?map"):
        wire.decode(pb.FromProbe(polarization_map=good | fault).SerializeToString())
