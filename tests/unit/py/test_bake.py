"""Meshes that shade themselves: against light without shadows, shapes, and rays one by one."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from lightprobe import geometry
from lightprobe.bake import Bake, mesh, visibility
from lightprobe.errors import UsageError
from lightprobe.estimate import Estimate, EstimateFlag, Light, SphericalHarmonics

UP = np.array([0.0, 1, 0])


def estimate(lights=(), coefficients=((0.0, 0, 0),)):
    c = np.asarray(coefficients, float)
    harmonics = SphericalHarmonics("AMBIENT", round(len(c) ** 0.5) - 1, c)
    return Estimate(1, 2, 3, 4, 500, EstimateFlag(0), tuple(lights), harmonics, 0.01, None, 1, None)


def lamp(direction, radius_deg=0.5):
    return Light(1, geometry.normalize(direction), np.array([3.0, 2, 1]), radius_deg)


def bake(shape, directions=512):
    return Bake.of_mesh(shape.vertices, shape.vertex_normals, shape.faces, directions)


@pytest.fixture(scope="module")
def ball():
    return bake(trimesh.creation.icosphere(3), 2048)


@pytest.fixture(scope="module")
def roof():
    """A floor of 2 m, and a roof of 1 m half a metre above it."""
    floor = trimesh.creation.box((2, 0.1, 2)).subdivide().subdivide().subdivide()
    top = trimesh.creation.box((1, 0.1, 1), trimesh.transformations.translation_matrix((0, 0.5, 0)))
    return bake(trimesh.util.concatenate([floor, top]), 1024)


def test_a_ball_shades_nothing(ball):
    """Then the irradiance is what the packet says for the normals."""
    rng = np.random.default_rng(3)
    light = estimate(
        [lamp((1, 2, 3)), lamp((-1, 0.2, 0.1), 12)], [(5.0, 4, 3), *rng.normal(size=(8, 3))]
    )
    true = light.irradiance(ball.normals)
    assert np.abs(ball.irradiance(light) - true).max() < 0.02 * true.max()


def test_vectors_give_the_same(ball, roof):
    rng = np.random.default_rng(4)
    light = estimate([lamp((1, 5, 2))], [(9.0, 9, 9), *rng.normal(size=(24, 3))])
    for one in (ball, roof):
        vectors = one.vector_irradiance(light)
        # Of a lamp below the surface a vector knows nothing, the irradiance does.
        above = one.normals @ light.lights[0].direction > 0
        by_vectors = np.einsum("nck,nk->nc", vectors, one.normals)[above]
        assert by_vectors == pytest.approx(one.irradiance(light)[above], rel=1e-3, abs=1e-3)


def test_what_is_under_a_roof_is_dark_and_what_is_beside_it_is_not(roof):
    lit = roof.irradiance(estimate([lamp(UP)]))[:, 0]
    x, y, z = roof.vertices.T
    top = (y > 0) & (y < 0.1) & (roof.normals[:, 1] > 0.9)
    under = np.maximum(np.abs(x), np.abs(z)) < 0.4
    beside = np.maximum(np.abs(x), np.abs(z)) > 0.6
    assert (top & under).sum() >= 9
    assert (top & beside).sum() > 9
    assert lit[top & under].max() < 0.02 * 3
    assert lit[top & beside] == pytest.approx(3.0 * roof.normals[top & beside, 1], rel=0.02)


def test_a_sky_beside_a_roof_is_as_large_as_it_is(roof):
    """The form factor of a square above a point in its axis, in closed form."""
    lit = roof.irradiance(estimate(coefficients=[(np.sqrt(4 * np.pi),) * 3]))[:, 0]
    middle = np.argmin(np.linalg.norm(roof.vertices - [0, 0.05, 0], axis=1))
    a = 0.5 / 0.4  # half of the square's side over its height
    factor = 4 / np.pi * a / np.sqrt(1 + a * a) * np.arctan(a / np.sqrt(1 + a * a))
    assert lit[middle] == pytest.approx(np.pi * (1 - factor), abs=0.02 * np.pi)


def by_one_ray_each(vertices, triangles, directions):
    """Tell what each vertex sees, and of which rays rounding does not decide."""
    seen = np.ones((len(directions), len(vertices)), bool)
    clear = np.ones_like(seen)
    for k, d in enumerate(directions):
        for triangle in triangles:
            a, b, c = vertices[triangle]
            system = np.stack([-d, b - a, c - a], axis=1)
            edge_on = abs(np.linalg.det(system)) < 1e-9
            own = np.isin(np.arange(len(vertices)), triangle)
            if edge_on:
                clear[k] = False
                continue
            t, s, u = np.linalg.solve(system, (vertices - a).T)
            margins = np.abs([s, u, 1 - s - u])
            clear[k] &= own | ((margins > 1e-6).all(axis=0) & (np.abs(t) > 1e-3))
            seen[k] &= own | ~((t > 0) & (s > 0) & (u > 0) & (s + u < 1))
    return seen, clear


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 30))
def test_random_triangles_hide_what_they_hide(seed, count):
    rng = np.random.default_rng(seed)
    vertices, triangles = rng.normal(size=(3 * count, 3)), np.arange(3 * count).reshape(-1, 3)
    along = geometry.normalize(rng.normal(size=(5, 3)))
    seen = visibility.visible(vertices, triangles, along)
    true, clear = by_one_ray_each(vertices, triangles, np.concatenate([along, -along]))
    assert clear.mean() > 0.5
    assert np.array_equal(seen[clear], true[clear])


def test_a_file_holds_all_of_it(roof, tmp_path):
    file = tmp_path / "roof.npz"
    file.write_bytes(roof.encode())
    light = estimate([lamp((1, 3, 2))], [(1.0, 2, 3)])
    assert np.array_equal(Bake.load(file).irradiance(light), roof.irradiance(light))


@pytest.mark.parametrize("content", [b"", b"no zip", "cut", "other"])
def test_what_is_no_baked_mesh_is_refused(roof, tmp_path, content):
    file = tmp_path / "x.npz"
    if content == "other":
        np.savez(file, vertices=np.zeros(3))
    else:
        file.write_bytes(roof.encode()[:9000] if content == "cut" else content)
    with pytest.raises(UsageError, match=r"x\.npz: not a baked mesh: .*: bake it again"):
        Bake.load(file)


@pytest.mark.parametrize("kind", mesh.READ[:2] + mesh.READ[3:])
def test_meshes_are_read_in_their_places(tmp_path, kind):
    file = tmp_path / f"x{kind}"
    shape = trimesh.creation.box((1, 2, 3), trimesh.transformations.translation_matrix((5, 0, 0)))
    shape.export(file)
    read = mesh.read(file)
    assert read.open_edges == 0
    assert read.vertices.min(axis=0) == pytest.approx([4.5, -1, -1.5])
    outward = ((read.vertices - [5, 0, 0]) * read.normals).sum(axis=1)
    assert (outward > 0).all()
    flipped = mesh.read(file, flip=True)
    assert (((flipped.vertices - [5, 0, 0]) * flipped.normals).sum(axis=1) < 0).all()


SHAPES = {
    "ball": trimesh.creation.icosphere(2),
    "box": trimesh.creation.box(),
    "ring": trimesh.creation.torus(1, 0.3),
}


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_triangles_that_face_inward_are_found(tmp_path, shape):
    file = tmp_path / "x.ply"
    shape = shape.copy()
    shape.invert()
    shape.export(file)
    for flip in (False, True):
        read = mesh.read(file, flip)
        inward = Bake.of_mesh(read.vertices, read.normals, read.triangles, 256).inward
        assert inward.mean() < 0.01 if flip else inward.mean() > 0.7


def test_a_sheet_faces_neither_way(roof):
    sheet = trimesh.Trimesh([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)])
    assert not bake(sheet).inward.any()
    assert not roof.inward.any()


def test_holes_are_counted(tmp_path):
    file = tmp_path / "x.ply"
    shape = trimesh.creation.box()
    trimesh.Trimesh(shape.vertices, shape.faces[1:]).export(file)
    assert mesh.read(file).open_edges == 3


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "cannot be read as a mesh|holds no triangles"),
        ("v 0 0 0\nv 1 0 0\n", "holds no triangles"),
        ("v 0 0 0\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n", "no numbers"),
        ("v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n", "all its vertices are at one place"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "cannot be read as a mesh"),
    ],
)
def test_bad_meshes_are_refused(tmp_path, content, message):
    file = tmp_path / "x.obj"
    file.write_text(content)
    with pytest.raises(UsageError, match=message):
        mesh.read(file)


def test_colours_of_a_lit_mesh(roof):
    light = roof.irradiance(estimate([lamp(UP)]))
    data, white = mesh.encode(".ply", roof, light, 0.5)
    assert white == pytest.approx(0.5 / np.pi * light.max())
    read = trimesh.load(trimesh.util.wrap_as_stream(data), file_type="ply", process=False)
    raw = read.metadata["_ply_raw"]["vertex"]["data"]
    assert np.array_equal(raw["irradiance_g"], light[:, 1].astype(np.float32))
    assert np.abs(read.visual.vertex_colors[:, :3] / 255 - light / light.max()).max() < 0.003
