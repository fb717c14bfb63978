"""The printable parts as rendered: whole, printable, fitting; the comb as firmware expects it."""

import itertools
import re

import mass
import numpy as np
import pytest
import readme
import trimesh
from dimensions import ROOT, lists
from meshes import SERVO_DEG, assembled, inside, part, polar, section, thickness

PARTS = (
    re.search(r"^HW_PARTS := (.*?)\n\n?HW", (ROOT / "hw/hw.mk").read_text(), re.S | re.M)[1]
    .replace("\\", "")
    .split()
)
ITEMS = (
    re.search(r"^HW_ITEMS := (.*?)\nHW", (ROOT / "hw/hw.mk").read_text(), re.S | re.M)[1]
    .replace("\\", "")
    .split()
)
BED_MM = 200
PLAY_MM3 = 1.0  # where faces touch, rounding makes slivers


@pytest.mark.parametrize("name", PARTS)
def test_every_part_is_one_watertight_body_on_the_bed(name: str) -> None:
    mesh = part(name)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0
    assert mesh.body_count == 1
    assert abs(mesh.bounds[0][2]) < 1e-3
    assert (mesh.extents < BED_MM).all()


@pytest.mark.parametrize("name", PARTS)
def test_walls_are_thick_enough_to_print(name: str, dim: dict[str, float]) -> None:
    walls = thickness(part(name))
    # The lip before the film is thin on purpose: two layers of its wall lie on the bed.
    least = dim["film_lip"] if name == "wheel_front" else dim["wall_min"]
    assert len(walls) > 100
    assert walls.min() >= least - 0.02, f"{walls.min():.2f} mm"


@pytest.mark.parametrize("name", PARTS)
def test_parts_stand_on_enough_of_the_bed_and_need_no_support(name: str) -> None:
    mesh = part(name)
    down = mesh.face_normals[:, 2] < -0.999
    on_bed = down & (mesh.triangles_center[:, 2] < 1e-3)
    ceiling = down & ~on_bed
    assert mesh.area_faces[on_bed].sum() > 60
    # Short bridges are printable, a quarter of the footprint is not.
    assert mesh.area_faces[ceiling].sum() < 0.25 * mesh.area_faces[on_bed].sum() + 150


# Never in one box with the headset's base, or with a board camera.
DRUM = {"base", "ring", "lid"}
BALL = {"cradle", "camera", "camera_plug"}
BOARD_CAMERA = {"module_cradle", "module"}
TOGETHER = [
    pair
    for pair in itertools.combinations(ITEMS, 2)
    if not ("headset_base" in pair and DRUM & set(pair))
    and not (BALL & set(pair) and BOARD_CAMERA & set(pair))
]


@pytest.mark.parametrize(("one", "other"), TOGETHER)
def test_nothing_collides(one: str, other: str) -> None:
    assert overlap_mm3(assembled(one), assembled(other)) < PLAY_MM3


def overlap_mm3(one: trimesh.Trimesh, other: trimesh.Trimesh) -> float:
    if (one.bounds[0] > other.bounds[1]).any() or (other.bounds[0] > one.bounds[1]).any():
        return 0.0
    common = trimesh.boolean.intersection([one, other], engine="manifold")
    return float(common.volume) if len(common.faces) else 0.0


TURNING = ("wheel_front", "wheel_comb", "wheel_back", "film")
MESHING = ("wheel_front", "servo_gear")


@pytest.mark.parametrize("wheel_deg", [-40, 13, 90, 183, 229])
def test_the_wheel_turns_free(wheel_deg: float) -> None:
    still = [name for name in ITEMS if name not in TURNING and name != "servo_gear"]
    for name in TURNING:
        mesh = assembled(name)
        # Forward is y here, so that counting from inside is counting against y.
        mesh.apply_transform(
            trimesh.transformations.rotation_matrix(np.radians(wheel_deg), [0, -1, 0])
        )
        for other in still:
            assert overlap_mm3(mesh, assembled(other)) < PLAY_MM3, (name, other)


def test_the_gears_mesh_over_a_whole_pitch(dim: dict[str, float]) -> None:
    pitch_deg = 360 / dim["wheel_gear_teeth"]
    servo_axis = [0, 0, -dim["axes_distance"]]
    ratio = dim["wheel_gear_teeth"] / dim["servo_gear_teeth"]
    free, tight = [], []
    for step in np.linspace(0, 1, 5):
        wheel, gear = (assembled(name) for name in MESHING)
        turn = np.radians(step * pitch_deg)
        wheel.apply_transform(trimesh.transformations.rotation_matrix(turn, [0, -1, 0]))
        gear.apply_transform(
            trimesh.transformations.rotation_matrix(-turn * ratio, [0, -1, 0], servo_axis)
        )
        free.append(overlap_mm3(wheel, gear))
        gear.apply_translation([0, 0, 0.6])
        tight.append(overlap_mm3(wheel, gear))
    assert max(free) < 0.05
    assert min(tight) > 0.05  # and it is the teeth that touch: 0.6 mm nearer they do


# --- the comb ----------------------------------------------------------------------------------


def firmware_parameter(name: str) -> float:
    found = re.search(rf"X\({name}, (-?\d+)", (ROOT / "firmware/params.h").read_text())
    assert found
    return float(found[1])


def seen_by(sensor: str, wheel_deg: np.ndarray, dim: dict[str, float]) -> np.ndarray:
    """Whether a tooth is in a sensor's beam, at many angles of the wheel."""
    comb = section(part("wheel_comb"), dim["comb_thickness"] / 2)
    return inside(comb, polar(dim[f"beam_{sensor}"], dim[f"sensor_{sensor}_deg"] - wheel_deg))


def test_the_comb_shows_the_firmware_what_it_expects(dim: dict[str, float]) -> None:
    """Edges as both sensors see them on the part itself, against COMB_* of firmware/params.h."""
    step = 0.02
    wheel_deg = np.arange(-40.5, 190, step) + step / 2
    a, b = (seen_by(sensor, wheel_deg, dim) for sensor in "ab")
    changes = np.flatnonzero((a[1:] != a[:-1]) | (b[1:] != b[:-1]))
    edges_deg = wheel_deg[changes] + step / 2
    first, pitch = (firmware_parameter(f"COMB_{n}_CDEG") / 100 for n in ("FIRST", "PITCH"))
    count = int(firmware_parameter("COMB_EDGES"))
    expected = first + pitch * np.arange(count)
    assert not a[0]
    assert not b[0]
    np.testing.assert_allclose(edges_deg[:count], expected, atol=step)
    # Upwards the sensors go 00, 01, 11, 10: A first.
    after = [(bool(a[i + 1]), bool(b[i + 1])) for i in changes[:4]]
    assert after == [(True, False), (True, True), (False, True), (False, False)]


def test_counting_goes_on_above_the_last_edge(dim: dict[str, float]) -> None:
    """Pushed beyond the comb that the firmware knows, the signals are still those of a comb."""
    wheel_deg = np.arange(-40.5, 229.5, 0.02)
    a, b = (seen_by(sensor, wheel_deg, dim) for sensor in "ab")
    assert not ((a[1:] != a[:-1]) & (b[1:] != b[:-1])).any()
    quarter = np.where(a & b, 2, np.where(a, 1, np.where(b, 3, 0)))
    assert set(np.diff(quarter) % 4) == {0, 1}


def test_the_whole_aperture_is_covered_or_free(dim: dict[str, float]) -> None:
    """The slit, as high as a zone allows, sees what the middle of the beam sees."""
    comb = section(part("wheel_comb"), dim["comb_thickness"] / 2)
    wheel_deg = np.arange(-40.0, 184, 6) + 1.0
    for sensor in "ab":
        at = dim[f"sensor_{sensor}_deg"] - wheel_deg
        middle, upper, lower = (
            inside(comb, polar(dim[f"beam_{sensor}"] + d, at)) for d in (0, 1.1, -1.1)
        )
        assert (middle == upper).all()
        assert (middle == lower).all()


def test_gauge_holes_hold_the_wheel_where_the_signals_change(
    dim: dict[str, float],
) -> None:
    back = section(part("wheel_back"), dim["rim_thickness"] / 2)
    # This part is printed turned over: its angles are mirrored.
    for gauge_deg in lists()["gauge_angles"]:
        hole = polar(dim["gauge_radius"], -(dim["gauge_deg"] - gauge_deg))
        assert not inside(back, hole).any()
        assert inside(back, hole * 1.06).all()
    plate = section(part("plate"), 1)
    assert not inside(plate, polar(dim["gauge_radius"], dim["gauge_deg"])).any()
    edges = dim["comb_first_deg"] + dim["comb_step_deg"] * np.arange(68)
    a_edge, b_edge = lists()["gauge_angles"][1:]
    assert np.flatnonzero(np.isclose(edges, a_edge)) % 2 == 0
    assert np.flatnonzero(np.isclose(edges, b_edge)) % 2 == 1


# --- fits --------------------------------------------------------------------------------------


def free_radius(name: str, z: float, centre: tuple[float, float] = (0, 0)) -> float:
    """Radius of the largest disc at a height of a part around a point that touches no material."""
    ends = section(part(name), z) - np.array(centre)
    a, d = ends[:, 0], ends[:, 1] - ends[:, 0]
    length = (d**2).sum(1)
    t = np.clip(-(a * d).sum(1) / np.where(length == 0, 1, length), 0, 1)
    return float(np.linalg.norm(a + t[:, None] * d, axis=1).min())


def outer_radius(name: str, z: float) -> float:
    """Radius of the smallest disc around the origin that covers a part at a height."""
    return float(np.linalg.norm(section(part(name), z), axis=2).max())


def test_film_and_spigot_fit_the_wheels_bore(dim: dict[str, float]) -> None:
    bore = free_radius("wheel_front", 3)
    back = part("wheel_back").bounds[1][2]
    assert dim["film_diameter"] / 2 < bore < dim["film_diameter"] / 2 + 0.3
    assert 0.2 < bore - outer_radius("wheel_back", back - 1) < 0.5
    assert free_radius("wheel_comb", 0.8) > outer_radius("wheel_back", back - 1)
    # The spigot ends where the film is, so that it clamps it.
    depth = (
        dim["film_lip"] + dim["film_thickness"] + back - dim["rim_thickness"] - dim["rim_shoulder"]
    )
    assert depth == pytest.approx(dim["comb_thickness"] + dim["wheel_front_thickness"], abs=0.01)


def test_the_camera_fits_through_wheel_and_plate(dim: dict[str, float]) -> None:
    assert free_radius("wheel_back", 5) > dim["camera_diameter"] / 2 + 2
    assert free_radius("plate", 1) > dim["camera_diameter"] / 2 + 2


HIDDEN = {"screws", "headset_base"}  # the screwdriver's way; not with sensors


def test_sensors_see_a_free_half_space(dim: dict[str, float]) -> None:
    """No part of the box, wheel and camera included, is before the face of any light sensor."""
    points = np.concatenate([assembled(name).vertices for name in ITEMS if name not in HIDDEN])
    for k in range(8):
        facing = np.array([np.cos(k * np.pi / 4), -np.sin(k * np.pi / 4), 0])
        assert (points @ facing).max() <= dim["ring_flat"] + 0.01, k
    assert points[:, 2].max() <= dim["ldr_top_z"] + 0.01


def test_ldr_seats_face_where_the_convention_says(dim: dict[str, float]) -> None:
    """Sensor k faces (cos 45k, 0, sin 45k) in the probe frame: a seat there, with a floor."""
    cut = section(part("ring"), dim["ring_height"] / 2)
    for k in range(8):
        angle = -45.0 * k
        radii = np.arange(dim["ring_flat"] - dim["ldr_depth"] + 0.1, dim["ring_flat"], 0.1)
        assert not inside(cut, np.concatenate([polar(r, angle) for r in radii])).any()
        floor = dim["ring_flat"] - dim["ldr_depth"] - 0.6
        assert inside(cut, polar(floor, angle)).all()


def test_tripod_nut_and_screw_fit() -> None:
    floor = free_radius("base", 1.0)
    nut = free_radius("base", 6.0)
    assert 6.35 / 2 < floor < 6.35 / 2 + 0.3  # 1/4 inch
    assert 11.11 / 2 < nut < 11.11 / 2 + 0.15  # across flats, 7/16 inch


@pytest.mark.parametrize("x", [-29, 29])
@pytest.mark.parametrize("y", [-24.5, 24.5])
def test_a_raspberry_pi_fits_its_mount(x: float, y: float, dim: dict[str, float]) -> None:
    """Holes as in its mechanical drawing, 58 × 49 mm; a screw of 12 mm ends within the post."""
    board_mm, screw_mm = 1.4, 12
    top = part("pi_mount").bounds[1][2]
    for z in (top - 0.5, top - (screw_mm - board_mm) - 0.1):
        hole = free_radius("pi_mount", z, (x, y))
        assert hole == pytest.approx(dim["wheel_screw_hole"] / 2, abs=0.05)
    assert inside(section(part("pi_mount"), 0.6), np.array([[x, y]])).all()


def test_led_and_button_fit_the_mount_of_the_computer_beside_its_leg(
    dim: dict[str, float],
) -> None:
    """An LED of 5 mm, a thread of 7 mm with a nut of 11 mm; neither meets board, leg or column."""
    nut_mm, board_end_mm, column_mm = 11, 58 / 2 + 3.5, 15
    x = -dim["pi_holes_long"] / 2 - dim["pi_ear"] / 2 - 6
    assert x + nut_mm / 2 < -board_end_mm
    assert dim["pi_ear_hole"] - nut_mm / 2 > column_mm
    for y, d_mm, room_mm in ((dim["pi_ear_hole"], 5, 0.15), (-dim["pi_ear_hole"], 7, 0.4)):
        for z in (0.5, dim["pi_plate"] - 0.5):
            assert d_mm / 2 < free_radius("pi_mount", z, (x, y)) < (d_mm + room_mm) / 2
        around = [
            [x + nut_mm / 2 * np.cos(a), y + nut_mm / 2 * np.sin(a)] for a in np.arange(0, 6, 0.5)
        ]
        assert inside(section(part("pi_mount"), dim["pi_plate"] - 0.5), np.array(around)).all()


def test_straps_and_a_tripods_leg_fit_the_mount_of_the_computer(dim: dict[str, float]) -> None:
    for z in (0.5, dim["pi_plate"] - 0.5):
        for x in (-1, 1):
            at = (x * (dim["strap_width"] / 2 + 3), dim["pi_strap"])
            assert free_radius("pi_mount", z, at) == pytest.approx(dim["strap_slot"] / 2, abs=0.01)
    # A leg of 15 mm touches the groove's edges and not its ground.
    half, leg = dim["pi_groove"] / 2, 7.5
    ground = np.array([[0.0, 0.0]])
    sunk = leg - np.sqrt(leg**2 - half**2)
    assert not inside(section(part("pi_mount"), sunk - 0.02), ground).any()


def test_the_headsets_base_takes_the_place_of_the_drums(dim: dict[str, float]) -> None:
    """Pillars and board posts are where the drum's base has them; straps go through."""
    for x in (-1, 1):
        at = (x * dim["tab_x"], -dim["plate_z"] + 4.5)
        top = dim["plate_crotch"] - dim["drum_bottom"]
        for name in ("base", "headset_base"):
            assert inside(section(part(name), top - 1), np.array([at])).all(), name
    posts = dim["drum_floor"] + dim["board_post"] - 1
    corner = (
        dim["board_width"] / 2 - 3.5,
        dim["board_y"] + dim["board_depth"] / 2 - 3.5,
    )
    assert free_radius("headset_base", posts, corner) == pytest.approx(1.3, abs=0.1)
    slot = (
        dim["headset_length"] / 2 - 6,
        dim["headset_y"] + dim["headset_width"] / 2 - 21,
    )
    assert free_radius("headset_base", 1, slot) == pytest.approx(dim["strap_slot"] / 2, abs=0.01)


@pytest.mark.skipif(SERVO_DEG != 180, reason="the headset's variant has the small servo")
def test_a_headset_carries_200_g_at_most() -> None:
    """Beside the camera; and hw/README.md says what it weighs."""
    printed_g, solid_g = mass.total(mass.headset())
    assert printed_g < solid_g
    assert printed_g <= 200
    text = (ROOT / "hw/README.md").read_text()
    assert readme.renewed(text, readme.rendered_tables()) == text, "make hw-docs"


def test_gear_ratios_are_those_of_the_firmware(dim: dict[str, float]) -> None:
    """500 to 2500 us are 270 degrees of the wheel, whatever the servo's travel."""
    us_deg = 2000 / (SERVO_DEG * dim["servo_gear_teeth"] / dim["wheel_gear_teeth"])
    assert us_deg == pytest.approx(firmware_parameter("SERVO_GAIN_NS_DEG") / 1000, abs=1e-3)
    assert dim["servo_gear_teeth"] == int(dim["servo_gear_teeth"])
