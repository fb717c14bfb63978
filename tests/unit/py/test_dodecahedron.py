"""The paper dodecahedron: its geometry, its net, and light on faces whose readings are known."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lightprobe.geometry import angle_deg
from lightprobe.probe.dodecahedron import light, net, pose, published, solid
from lightprobe.probe.dodecahedron.faces import Reading
from lightprobe.probe.kinds import ProbeError
from lightprobe.probe.paper import PAPER
from matplotlib.backends.backend_agg import FigureCanvasAgg
from scipy.spatial.transform import Rotation

EDGE_MM = 30.0
NUMBERS = st.integers(0, solid.FACES - 1)
DIRECTIONS = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.2)


@given(NUMBERS)
def test_each_face_is_a_regular_pentagon_with_edges_of_1(number):
    face = solid.faces()[number]
    assert np.linalg.norm(face.vertices - np.roll(face.vertices, 1, axis=0), axis=1) == (
        pytest.approx(np.ones(5))
    )
    assert (face.vertices @ face.normal) == pytest.approx(np.full(5, solid.INRADIUS))
    # Counter-clockwise from outside.
    first = np.cross(face.vertices[1] - face.vertices[0], face.vertices[2] - face.vertices[1])
    assert first @ face.normal > 0


@given(NUMBERS)
def test_each_face_has_five_neighbours_and_an_opposite_one(number):
    cosines = np.sort(solid.normals() @ solid.normals()[number])
    expected = [-1, *[-1 / np.sqrt(5)] * 5, *[1 / np.sqrt(5)] * 5, 1]
    assert cosines == pytest.approx(expected)


@given(NUMBERS)
def test_a_marker_lies_in_its_face_with_white_around(number):
    face = solid.faces()[number]
    assert (face.marker @ face.normal) == pytest.approx(np.full(4, solid.INRADIUS))
    others = np.delete(solid.normals(), number, axis=0)
    # As far from all other faces' planes as a seventh of an edge beside the shared one.
    inside = (solid.INRADIUS - face.marker @ others.T).min() / (2 / np.sqrt(5))
    assert inside > 1 / 7


def test_the_solid_has_twenty_vertices():
    corners = np.concatenate([face.vertices for face in solid.faces()])
    assert len(np.unique(np.round(corners, 6), axis=0)) == 20


@pytest.mark.parametrize("index", [0, 1])
def test_faces_of_a_sheet_do_not_overlap_and_are_not_mirrored(index):
    flats = net.sheet(index)
    for flat in flats:
        a, b, c = flat.vertices[:3]
        assert (b - a)[0] * (c - b)[1] - (b - a)[1] * (c - b)[0] > 0
    middles = np.array([flat.centre for flat in flats])
    apart = np.linalg.norm(middles[:, None] - middles, axis=-1) + 9 * np.eye(6)
    assert apart.min() == pytest.approx(2 * solid.EDGE)


def test_each_edge_is_folded_or_has_one_tab():
    tabs = [tab.number for index in (0, 1) for tab in net.tabs(index)]
    assert len(tabs) == len(set(tabs)) == 20  # of 30; ten are folded
    sides = {number for face in range(solid.FACES) for _, number, _ in net.edges_of(face)}
    assert sides == set(range(1, 31))


@pytest.mark.parametrize("index", [0, 1])
def test_the_printed_sheet_has_its_markers_to_scale(index):
    per_mm = 6.0
    canvas = FigureCanvasAgg(net.figure(index, EDGE_MM))
    canvas.figure.set_dpi(25.4 * per_mm)
    canvas.draw()
    grey = np.asarray(canvas.buffer_rgba())[..., 0].copy()
    numbers, corners = pose.markers(grey)
    assert sorted(numbers) == ([0, 1, 2, 3, 4, 5], [6, 7, 8, 9, 10, 11])[index]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2) / per_mm
    assert sides == pytest.approx(np.full(sides.shape, solid.MARKER * EDGE_MM), abs=0.2)
    # All within what printers reach, at the largest edge.
    outer = np.concatenate([tab.outline for tab in net.tabs(index)])
    assert np.abs(outer[:, 0]).max() * net.LARGEST_MM < net.SHEET_MM[0] / 2 - 5


@given(st.integers(0, 10**6))
def test_the_pose_of_markers_is_found_again(seed):
    random = np.random.default_rng(seed)
    turn = Rotation.random(random_state=seed).as_matrix()
    centre = np.array([random.uniform(-2, 2), random.uniform(-2, 2), -random.uniform(8, 20)])
    pinhole = pose.Pinhole(1200.0, 1200.0, 640.0, 480.0, (0.05, -0.02, 0.001, 0.0))
    numbers, corners = [], []
    for number, face in enumerate(solid.faces()):
        middle = turn @ face.centre + centre
        if (turn @ face.normal) @ -middle / np.linalg.norm(middle) > 0.3:
            numbers.append(number)
            corners.append(pinhole.places(face.marker @ turn.T + centre))
    found = pose.solved(numbers, np.array(corners), pinhole, 40.0)
    assert found.rotation == pytest.approx(turn, abs=1e-3)
    assert found.centre == pytest.approx(centre, abs=0.02)


def read(turn, direction, lamp, even, noise=0.0, seed=0, camera=(0, 0, 12.0)):
    """Faces that a camera sees, under a far lamp and even light."""
    random = np.random.default_rng(seed)
    found = []
    for number, face in enumerate(solid.faces()):
        normal, place = turn @ face.normal, turn @ face.centre
        to = np.array(camera) - place
        if normal @ to / np.linalg.norm(to) < 0.25:
            continue
        light_on = (np.array(lamp) * max(normal @ direction, 0) + even) * PAPER / np.pi
        found.append(Reading(
            number, normal, place, ((face.vertices + face.centre) / 2) @ turn.T,
            np.array(camera), light_on * (1 + noise * random.normal()), 0.0, 0.0,
        ))  # fmt: skip
    return found


@pytest.mark.parametrize("seed", range(6))
def test_several_poses_give_the_lamp(seed):
    random = np.random.default_rng(seed)
    direction = random.normal(size=3)
    direction[2] = abs(direction[2]) + 0.3
    direction /= np.linalg.norm(direction)
    turns = Rotation.random(4, random_state=seed).as_matrix()
    readings = [
        one for k, turn in enumerate(turns)
        for one in read(turn, direction, (1.0, 0.9, 0.7), 0.2, 0.005, k)
    ]  # fmt: skip
    found = light.solve(readings, EDGE_MM)
    assert len(found.lamps) == 1
    off_deg = angle_deg(found.lamps[0].direction, direction)
    assert off_deg < 1.5
    assert off_deg < 3 * found.lamps[0].direction_sigma_deg
    assert found.lamps[0].irradiance == pytest.approx([1.0, 0.9, 0.7], rel=0.1)


def test_even_light_has_no_lamp():
    readings = read(np.eye(3), np.array([0, 0, 1.0]), (0, 0, 0), 0.5, 0.003)
    found = light.solve(readings, EDGE_MM)
    assert found.lamps == ()
    assert found.ambient == pytest.approx(np.full(3, 0.5), rel=0.05)
    assert any("no lamp stands out" in note for note in found.notes)


def test_too_few_faces_are_refused():
    readings = read(np.eye(3), np.array([0, 0, 1.0]), (1, 1, 1), 0.1)
    with pytest.raises(ProbeError, match="three are needed"):
        light.solve(readings[:2], EDGE_MM)


@given(DIRECTIONS)
def test_the_published_ways_give_a_direction(direction):
    direction = np.array(direction) / np.linalg.norm(direction)
    readings = read(np.eye(3), direction, (1, 1, 1), 0.2)
    normals = np.stack([one.normal for one in readings])
    values = np.array([one.radiance.mean() for one in readings])
    for found in (published.straughn(normals, values), published.thesis(normals, values)):
        assert np.linalg.norm(found) == pytest.approx(1)


def test_the_thesis_takes_the_brightest_face_and_turns_round_in_the_dark():
    normals = solid.normals()[:5]
    values = np.array([0.2, 0.6, 0.3, 0.25, 0.2])
    assert published.thesis(normals, values) == pytest.approx(normals[1])
    assert published.thesis(normals, values / 100) == pytest.approx(-normals[1])
    equal = np.array([0.6, 0.6, 0.3, 0.25, 0.2])
    mean = normals[0] + normals[1]
    assert published.thesis(normals, equal) == pytest.approx(mean / np.linalg.norm(mean))


def test_markers_are_not_those_of_the_boards():
    """A board in the picture must not be taken for a face."""
    board = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_250)
    assert board.markerSize != solid.dictionary().markerSize
