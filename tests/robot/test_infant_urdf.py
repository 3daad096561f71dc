"""The infant as it stands in its two files, judged by Pinocchio and an XML parser alone."""

from __future__ import annotations

import itertools
import math
import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

FOLDER = Path(__file__).parents[2] / "urdf"
URDF = FOLDER / "infant.urdf"
ROOT = ET.parse(URDF).getroot()
BODY = tomllib.loads((FOLDER / "infant.toml").read_text())
HAND, CAMERA, SKIN = BODY["hand"], BODY["camera"], BODY["skin"]
DENSITY = 1050.0  # [kg/m3], as the URDF's head says
MIRROR = np.diag([1.0, -1.0, 1.0])
ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist")
LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll", "toe")
JOINTS = ["neck", *(f"{side}_{joint}" for limb in (ARM, LEG) for side in ("left", "right") for joint in limb)]


def part(element: ET.Element, path: str) -> ET.Element:
    (found,) = element.findall(path)
    return found


def link(name: str) -> ET.Element:
    return part(ROOT, f"link[@name='{name}']")


def numbers(element: ET.Element, attribute: str) -> np.ndarray:
    return np.array([float(word) for word in element.attrib[attribute].split()])


def placement(element: ET.Element) -> pin.SE3:
    origin = part(element, "origin")
    rpy = numbers(origin, "rpy") if "rpy" in origin.attrib else np.zeros(3)
    return pin.SE3(pin.rpy.rpyToMatrix(*rpy), numbers(origin, "xyz"))


def moving_joints() -> list[ET.Element]:
    return [joint for joint in ROOT.findall("joint") if joint.attrib["type"] != "fixed"]


# The left arm by Pinocchio: the full model, every other joint at home.

MODEL = pin.buildModelFromUrdf(str(URDF))
DATA = MODEL.createData()
COLUMNS = [MODEL.joints[MODEL.getJointId(name)].idx_v for name in BODY["joints"]]
LOWER, UPPER = MODEL.lowerPositionLimit[COLUMNS], MODEL.upperPositionLimit[COLUMNS]
FULL_HOME = pin.neutral(MODEL)
for name, value in BODY["home"].items():
    FULL_HOME[MODEL.joints[MODEL.getJointId(name)].idx_q] = value
HOME = FULL_HOME[COLUMNS]


def full_posture(q: np.ndarray) -> np.ndarray:
    full = FULL_HOME.copy()
    full[COLUMNS] = q
    return full


def frame(name: str) -> int:
    assert MODEL.existFrame(name, pin.BODY)
    return MODEL.getFrameId(name, pin.BODY)


def pose(name: str, q: np.ndarray = HOME) -> pin.SE3:
    pin.framesForwardKinematics(MODEL, DATA, full_posture(q))
    return DATA.oMf[frame(name)].copy()


def hand_position(q: np.ndarray) -> np.ndarray:
    return pose(HAND["link"], q).act(np.array(HAND["offset"]))


def hand_jacobian(q: np.ndarray) -> np.ndarray:
    jacobian = pin.computeFrameJacobian(
        MODEL, DATA, full_posture(q), frame(HAND["link"]), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    )
    return jacobian[:3, COLUMNS]


def least_displacement(target: np.ndarray, start: np.ndarray = HOME) -> np.ndarray:
    """The posture nearest to home with the hand at ``target``: Newton steps, home drawing within the null space."""
    q = start.copy()
    for _ in range(200):
        jacobian = hand_jacobian(q)
        inverse = np.linalg.pinv(jacobian)
        step = HOME - q + inverse @ (target - hand_position(q) - jacobian @ (HOME - q))
        q = q + step * min(1.0, 0.2 / max(np.abs(step).max(), 1e-12))
        if np.abs(step).max() < 1e-11:
            return q
    raise AssertionError(f"no posture found for {target}")


def face() -> tuple[np.ndarray, np.ndarray]:
    """Taxels on the head's sphere and their outward normals, in the root: (rows * columns, 3) each."""
    shape = part(link(SKIN["link"]), "collision")
    middle, radius = placement(shape).translation, float(part(shape, "geometry/sphere").attrib["radius"])
    forward, right = np.array(SKIN["forward"]), np.array(SKIN["right"])
    down = np.cross(forward, right)
    rows, columns = SKIN["shape"]
    height, width = SKIN["size"]
    grid = itertools.product(np.linspace(-height, height, rows) / 2, np.linspace(-width, width, columns) / 2)
    starts = np.array(SKIN["centre"]) - middle + np.array([y * down + x * right for y, x in grid])
    along = starts @ forward
    outside = starts - along[:, None] * forward
    points = outside + np.sqrt(radius**2 - (outside**2).sum(-1))[:, None] * forward
    assert (along > points @ forward).all(), "the frontal plane must lie in front of the face"
    head = pose(SKIN["link"])
    return (points + middle) @ head.rotation.T + head.translation, points @ head.rotation.T / radius


SURFACE, NORMALS = face()
FORWARD = pose(SKIN["link"]).rotation @ np.array(SKIN["forward"])
TOUCH = SURFACE + HAND["radius"] * NORMALS
LANDMARKS = {name: row * SKIN["shape"][1] + column for name, (row, column) in SKIN["landmarks"].items()}
EYE = SURFACE[LANDMARKS[SKIN["eye"]]]
CENTRE = TOUCH[len(TOUCH) // 2]


@pytest.fixture(scope="module")
def on_face() -> np.ndarray:
    return np.array([least_displacement(target) for target in TOUCH])


@pytest.fixture(scope="module")
def in_front() -> np.ndarray:
    return np.array([least_displacement(target + 0.03 * FORWARD) for target in TOUCH])


def in_camera(points: np.ndarray) -> np.ndarray:
    """Points given in the root, along the image's x, y and depth [m]."""
    camera = pose(CAMERA["link"])
    forward, right = camera.rotation @ np.array(CAMERA["forward"]), camera.rotation @ np.array(CAMERA["right"])
    return (points - camera.translation) @ np.stack([right, np.cross(forward, right), forward], axis=-1)


def visible(points: np.ndarray) -> np.ndarray:
    seen = in_camera(points)
    depth, aside = seen[:, 2], np.linalg.norm(seen[:, :2], axis=-1)
    cone = aside <= depth * math.tan(math.radians(CAMERA["half_angle_degrees"]))
    # A straight way from a point of a sphere crosses the sphere exactly if it sets out inward.
    clear = (points - EYE) @ NORMALS[LANDMARKS[SKIN["eye"]]] > 0
    return (depth >= CAMERA["near"]) & cone & clear


def circle(distance: float, samples: int = 72, radius: float = 0.05) -> np.ndarray:
    """A circle of the hand parallel to the frontal plane, around the line through the middle of the face."""
    angles = np.linspace(0, 2 * np.pi, samples, endpoint=False)[:, None]
    right = pose(SKIN["link"]).rotation @ np.array(SKIN["right"])
    aside = np.cos(angles) * right + np.sin(angles) * np.cross(FORWARD, right)
    return CENTRE + distance * FORWARD + radius * aside


def margin(postures: np.ndarray) -> float:
    return float(np.minimum(postures - LOWER, UPPER - postures).min())


# The tree.


def test_25_revolute_joints_in_order_each_with_origin_axis_and_limits() -> None:
    joints = moving_joints()
    assert [joint.attrib["name"] for joint in joints] == JOINTS
    assert MODEL.nv == MODEL.nq == 25
    for joint in joints:
        assert joint.attrib["type"] == "revolute"
        axis = numbers(part(joint, "axis"), "xyz")
        np.testing.assert_array_equal(np.sort(np.abs(axis)), [0, 0, 1])
        assert joint.find("origin") is not None
        limit = part(joint, "limit")
        lower, upper, effort, velocity = (float(limit.attrib[key]) for key in ("lower", "upper", "effort", "velocity"))
        assert -np.pi < lower <= 0 < upper < np.pi
        assert min(effort, velocity) > 0


def test_names_are_unique() -> None:
    for kind in ("link", "joint", "material"):
        names = [element.attrib["name"] for element in ROOT.findall(kind)]
        assert len(set(names)) == len(names)


def test_each_arm_and_leg_moves_by_its_own_joints_alone() -> None:
    parent = {part(joint, "child").attrib["link"]: joint for joint in ROOT.findall("joint")}

    def path(end: str) -> list[str]:
        if end not in parent:
            return []
        joint = parent[end]
        above = path(part(joint, "parent").attrib["link"])
        return [*above, joint.attrib["name"]] if joint.attrib["type"] != "fixed" else above

    for side in ("left", "right"):
        assert path(f"{side}_hand") == [f"{side}_{joint}" for joint in ARM]
        assert path(f"{side}_toes") == [f"{side}_{joint}" for joint in LEG]
        assert path(f"{side}_eye") == ["neck"]


# The body.


def solid(geometry: ET.Element) -> tuple[float, np.ndarray]:
    """Volume [m3] and inertia about the middle, per mass [m2], of a primitive along its own axes."""
    if geometry.tag == "sphere":
        radius = float(geometry.attrib["radius"])
        return 4 / 3 * np.pi * radius**3, np.full(3, 2 / 5 * radius**2)
    if geometry.tag == "cylinder":
        radius, length = float(geometry.attrib["radius"]), float(geometry.attrib["length"])
        across = radius**2 / 4 + length**2 / 12
        return np.pi * radius**2 * length, np.array([across, across, radius**2 / 2])
    x, y, z = numbers(geometry, "size")
    return x * y * z, np.array([y**2 + z**2, x**2 + z**2, x**2 + y**2]) / 12


def test_mass_and_inertia_are_those_of_the_collision_primitive() -> None:
    for body in ROOT.findall("link"):
        inertial, collisions = body.find("inertial"), body.findall("collision")
        if inertial is None:
            assert not collisions
            continue
        (collision,) = collisions
        volume, moments = solid(part(collision, "geometry")[0])
        shape = placement(collision)
        mass = float(part(inertial, "mass").attrib["value"])
        ixx, ixy, ixz, iyy, iyz, izz = (
            float(part(inertial, "inertia").attrib[key]) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        )
        rotation = placement(inertial).rotation
        given = rotation @ np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]]) @ rotation.T
        due = volume * DENSITY * shape.rotation @ np.diag(moments) @ shape.rotation.T
        assert mass == pytest.approx(volume * DENSITY, rel=1e-5), body.attrib["name"]
        np.testing.assert_allclose(placement(inertial).translation, shape.translation, atol=1e-12)
        np.testing.assert_allclose(given, due, atol=1e-5 * np.abs(due).max(), err_msg=body.attrib["name"])


def test_every_moving_link_has_mass_and_the_whole_weighs_as_an_infant() -> None:
    assert all(MODEL.inertias[joint].mass > 0.005 for joint in range(1, MODEL.njoints))
    for joint in moving_joints():
        part(link(part(joint, "child").attrib["link"]), "inertial")
    assert 8 < sum(float(mass.attrib["value"]) for mass in ROOT.iter("mass")) < 10


def test_length_and_head_are_the_median_at_twelve_months() -> None:
    # WHO Child Growth Standards, mean of boys and girls: length 74.9 cm, head circumference 45.5 cm.
    pin.framesForwardKinematics(MODEL, DATA, pin.neutral(MODEL))
    head, foot = part(link("head"), "collision"), part(link("left_foot"), "collision")
    radius = float(part(head, "geometry/sphere").attrib["radius"])
    crown = DATA.oMf[frame("head")].act(placement(head).translation)[2] + radius
    thickness = numbers(part(foot, "geometry/box"), "size")[2]
    sole = DATA.oMf[frame("left_foot")].act(placement(foot).translation)[2] - thickness / 2
    assert crown - sole == pytest.approx(0.749, abs=0.001)
    assert 2 * np.pi * radius == pytest.approx(0.455, abs=0.0005)


def test_equal_joint_values_left_and_right_are_mirror_images() -> None:
    random = np.random.default_rng(0)
    sides = [(left, MODEL.getJointId(left.replace("left", "right", 1))) for left in JOINTS if left.startswith("left")]
    pairs = [(MODEL.joints[MODEL.getJointId(left)], MODEL.joints[right]) for left, right in sides]
    for left, right in pairs:
        for limit in (MODEL.lowerPositionLimit, MODEL.upperPositionLimit, MODEL.effortLimit, MODEL.velocityLimit):
            assert limit[left.idx_v] == limit[right.idx_v]
    lower, upper = MODEL.lowerPositionLimit, MODEL.upperPositionLimit
    for _ in range(20):
        q = random.uniform(lower, upper)
        q[MODEL.joints[MODEL.getJointId("neck")].idx_q] = 0  # the only joint in the middle
        for left, right in pairs:
            q[right.idx_q] = q[left.idx_q]
        pin.framesForwardKinematics(MODEL, DATA, q)
        for name in (body.attrib["name"] for body in ROOT.findall("link")):
            if name.startswith("left"):
                left_pose, right_pose = DATA.oMf[frame(name)], DATA.oMf[frame(name.replace("left", "right", 1))]
                np.testing.assert_allclose(right_pose.translation, MIRROR @ left_pose.translation, atol=1e-12)
                np.testing.assert_allclose(right_pose.rotation, MIRROR @ left_pose.rotation @ MIRROR, atol=1e-12)


def test_shapes_and_masses_are_mirrored() -> None:
    def shapes(body: ET.Element, mirror: float) -> list[tuple[object, ...]]:
        return sorted(
            (
                element.tag,
                *(placement(element).translation * [1, mirror, 1]),
                *np.abs(placement(element).rotation).round(9).ravel(),
                *((child.tag, *sorted(child.attrib.items())) for child in element.iter() if child.tag != "origin"),
            )
            for kind in ("visual", "collision")
            for element in body.findall(kind)
        )

    for name in (body.attrib["name"] for body in ROOT.findall("link")):
        if not name.startswith("right"):
            other = name.replace("left", "right", 1) if name.startswith("left") else name
            assert shapes(link(name), -1.0) == shapes(link(other), 1.0), name


def test_only_primitives_in_named_colours() -> None:
    colours = {material.attrib["name"] for material in ROOT.findall("material")}
    assert all(material.find("color") is not None for material in ROOT.findall("material"))
    for geometry in ROOT.iter("geometry"):
        assert [child.tag for child in geometry] in (["sphere"], ["cylinder"], ["box"])
    used = {part(visual, "material").attrib["name"] for visual in ROOT.iter("visual")}
    assert used == colours


def test_the_hand_is_the_sphere_that_the_embodiment_says() -> None:
    for side in ("left", "right"):
        for kind in ("visual", "collision"):
            element = part(link(f"{side}_hand"), kind)
            assert float(part(element, "geometry/sphere").attrib["radius"]) == HAND["radius"]
            np.testing.assert_array_equal(placement(element).translation, HAND["offset"])


# Face and camera.


def test_the_embodiment_feels_the_left_arm() -> None:
    assert BODY["joints"] == [f"left_{joint}" for joint in ARM]
    assert set(BODY["home"]) <= set(JOINTS)
    assert FOLDER / BODY["urdf"] == URDF


def test_landmarks_lie_as_in_a_face() -> None:
    rows = {name: row for name, (row, _) in SKIN["landmarks"].items()}
    columns = {name: column for name, (_, column) in SKIN["landmarks"].items()}
    assert rows["left_eye"] == rows["right_eye"] < rows["nose"] < rows["mouth"]
    assert columns["nose"] == columns["mouth"] == 10
    assert columns["left_eye"] + columns["right_eye"] == 20
    assert columns["right_eye"] > 10
    apart = SURFACE[LANDMARKS["left_eye"]] - SURFACE[LANDMARKS["right_eye"]]
    np.testing.assert_allclose(apart, [0, 0.042, 0], atol=1e-12)  # interpupillary distance; left is +y


def test_columns_grow_to_the_right_rows_downward_three_millimetres_apart() -> None:
    grid = SURFACE.reshape(*SKIN["shape"], 3)
    np.testing.assert_allclose(np.diff(grid[..., 1], axis=1), -0.003, atol=1e-12)
    np.testing.assert_allclose(np.diff(grid[..., 2], axis=0), -0.003, atol=1e-12)


@pytest.mark.parametrize("side", ["left", "right"])
def test_each_optical_centre_is_two_centimetres_behind_its_eye(side: str) -> None:
    behind = SURFACE[LANDMARKS[f"{side}_eye"]] - pose(f"{side}_eye").translation
    np.testing.assert_allclose(behind, 0.02 * FORWARD, atol=1e-6)
    np.testing.assert_allclose(pose(f"{side}_eye").rotation, np.eye(3), atol=1e-12)


def test_touching_beside_the_eye_the_depth_is_that_of_the_screen() -> None:
    assert in_camera(TOUCH[[LANDMARKS["right_eye"]]])[0, 2] == pytest.approx(CAMERA["distance"], abs=0.002)


def test_a_hand_that_touches_is_never_seen_and_its_image_keeps_the_order_of_the_taxels() -> None:
    seen = in_camera(TOUCH)
    assert ((seen[:, 2] > 0.02) & (seen[:, 2] < CAMERA["near"])).all()
    assert not visible(TOUCH).any()
    image = (CAMERA["distance"] * seen[:, :2] / seen[:, 2:]).reshape(*SKIN["shape"], 2)
    assert (np.diff(image[..., 0], axis=1) > 0).all()
    assert (np.diff(image[..., 1], axis=0) > 0).all()


@pytest.mark.parametrize("distance", [0.02, 0.03, 0.06, 0.1])
def test_a_circle_in_front_of_the_face_is_seen_all_along(distance: float) -> None:
    assert visible(circle(distance)).all()


# What the arm can do.


def test_home_is_within_limits_with_the_hand_in_sight_in_front_of_the_face() -> None:
    assert margin(HOME) > np.radians(15)
    assert visible(hand_position(HOME)[None]).all()
    ahead = hand_position(HOME) - CENTRE
    assert 0.03 < ahead @ FORWARD < 0.08
    assert np.linalg.norm(ahead - (ahead @ FORWARD) * FORWARD) < 0.02


def test_every_taxel_can_be_touched_within_limits(on_face: np.ndarray) -> None:
    reached = np.array([hand_position(q) for q in on_face])
    np.testing.assert_allclose(reached, TOUCH, atol=1e-9)
    assert margin(on_face) > np.radians(15)


def test_the_hand_can_be_three_centimetres_in_front_of_every_taxel(in_front: np.ndarray) -> None:
    reached = np.array([hand_position(q) for q in in_front])
    np.testing.assert_allclose(reached, TOUCH + 0.03 * FORWARD, atol=1e-9)
    assert margin(in_front) > np.radians(20)


def test_postures_in_front_are_near_those_on_the_face(on_face: np.ndarray, in_front: np.ndarray) -> None:
    assert np.linalg.norm(on_face - in_front, axis=-1).max() < 0.3


def test_displacement_from_home_is_least(on_face: np.ndarray) -> None:
    # First order: at the nearest posture, home lies straight across the motions that keep the hand where it is.
    for q in on_face[::7]:
        keeping = np.linalg.svd(hand_jacobian(q))[2][3:]
        np.testing.assert_allclose(keeping @ (q - HOME), 0, atol=1e-9)
    # And no other start finds a nearer one.
    random = np.random.default_rng(0)
    for taxel in (0, 20, 220, 420, 440):
        for start in random.uniform(LOWER, UPPER, (10, 5)):
            try:
                other = least_displacement(TOUCH[taxel], start)
            except AssertionError:
                continue
            assert np.linalg.norm(other - HOME) > np.linalg.norm(on_face[taxel] - HOME) - 1e-8


def test_the_hand_moves_freely_in_every_direction(on_face: np.ndarray, in_front: np.ndarray) -> None:
    for q in np.concatenate([on_face, in_front]):
        assert np.linalg.svd(hand_jacobian(q), compute_uv=False)[2] > 0.06  # [m/rad]


def test_all_five_joints_move_the_hand(on_face: np.ndarray) -> None:
    for q in on_face:
        assert np.linalg.norm(hand_jacobian(q), axis=0).min() > 0.03  # [m/rad]


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize("distance", [0.0, 0.02, 0.03, 0.06, 0.1])
def test_three_turns_of_a_circle_stay_within_limits(distance: float, turn: int) -> None:
    path = circle(distance)[::turn]
    q, followed = least_displacement(path[0]), []
    for target in np.concatenate([path] * 3):
        q = q + np.linalg.pinv(hand_jacobian(q)) @ (target - hand_position(q))
        followed.append(q)
    # One step a sample: what is left over is of second order in steps of 4 mm.
    assert np.linalg.norm(hand_position(q) - path[-1]) < 2e-4
    assert margin(np.array(followed)) > np.radians(14)


def test_a_touching_arm_passes_through_neither_head_nor_trunk(on_face: np.ndarray) -> None:
    geometry = pin.buildGeomFromUrdf(MODEL, str(URDF), pin.GeometryType.COLLISION)
    pairs = [
        (f"left_{part}_0", f"{obstacle}_0")
        for part in ("upper_arm", "forearm", "palm", "hand")
        for obstacle in ("head", "torso")
    ]
    for pair in pairs:
        first, second = (geometry.getGeometryId(name) for name in pair)
        geometry.addCollisionPair(pin.CollisionPair(first, second))
    data = geometry.createData()
    for q in on_face:
        pin.computeDistances(MODEL, DATA, geometry, data, full_posture(q))
        for pair, result in zip(pairs, data.distanceResults, strict=True):
            assert result.min_distance > -1e-4, (pair, result.min_distance)


def test_at_home_the_arms_touch_nothing() -> None:
    geometry = pin.buildGeomFromUrdf(MODEL, str(URDF), pin.GeometryType.COLLISION)
    shapes = geometry.geometryObjects
    arm = {MODEL.getJointId(f"{side}_{joint}") for side in ("left", "right") for joint in ARM}
    for first, second in itertools.combinations(range(len(shapes)), 2):
        joints = shapes[first].parentJoint, shapes[second].parentJoint
        neighbours = joints[0] == joints[1] or any(MODEL.parents[one] == two for one, two in (joints, joints[::-1]))
        if arm & set(joints) and not neighbours:
            geometry.addCollisionPair(pin.CollisionPair(first, second))
    data = geometry.createData()
    pin.computeDistances(MODEL, DATA, geometry, data, FULL_HOME)
    assert len(geometry.collisionPairs) > 100
    for pair, result in zip(geometry.collisionPairs, data.distanceResults, strict=True):
        assert result.min_distance > 0, (shapes[pair.first].name, shapes[pair.second].name)
