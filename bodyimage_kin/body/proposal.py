"""A first body of a robot that nobody described yet: joints, hand, eye, patch of skin and home, and why each.

What is proposed is the experiment of Fuke et al. (2007) on another robot: a hand that is seen while it moves in front
of the face, and never while it touches. Lengths that the paper gives for an infant are kept where the robot's own size
says nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy.spatial
import torch
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin._arrays import ArrayLike, as_float_array
from bodyimage_kin.backends import kinematics
from bodyimage_kin.body.cameras import Camera, VirtualScreen
from bodyimage_kin.body.check import Finding, check_embodiment
from bodyimage_kin.body.collisions import Hulls, vertices_of
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.body.hand import Hand
from bodyimage_kin.body.skin import Skin
from bodyimage_kin.errors import BodyImageKinError, InvalidConfig, InvalidGeometry, UnknownName, Unreachable
from bodyimage_kin.robot import Robot
from bodyimage_kin.robot.geometry import Collision, Cylinder

__all__ = ["Proposal", "propose"]

_SHAPE = (21, 21)
_LANDMARKS = {"left_eye": (6, 3), "right_eye": (6, 17), "nose": (10, 10), "mouth": (15, 10)}
"""Of the infant's face, which has the paper's number of taxels."""
_HIDDEN = 0.02
"""How far behind the face the paper's optical centre lies on the infant [m]."""
_IN_FRONT = (0.05, 0.04, 0.03, 0.06, 0.08)
"""Distances in front of the face at which home is looked for, the infant's first [m]."""
_STARTS, _DRAWN = 24, 2000
_SMALLER = (1.0, 0.8, 0.6, 0.45)
_SHARE, _LARGEST_PATCH, _FACE = 0.6, 0.12, 0.05
_RADIUS = (0.01, 0.04)
_CLEAR = 0.002  # [m] between the deepest hand that touches and the nearest that is seen
_EYES = ("right_eye", "righteye", "r_eye", "eye_right", "eye", "camera", "_cam", "head", "skull", "face")
_ARMS = ("hand", "wrist", "arm", "grip", "finger")
"""Parts of names of links that carry other cameras."""


@dataclass(frozen=True)
class Proposal:
    """A body, and the reasons for it.

    Attributes:
        body: The proposed embodiment.
        remarks: What was chosen, and from what, a sentence each.
        findings: What :func:`bodyimage_kin.body.check_embodiment` finds of it by the paper's protocol, collisions
            beside.
    """

    body: Embodiment
    remarks: tuple[str, ...]
    findings: tuple[Finding, ...]

    @property
    def works(self) -> bool:
        """Whether nothing was found that keeps the paper's experiment from running."""
        return not any(finding.level == "error" for finding in self.findings)


def propose(
    robot: Robot,
    hand: str,
    *,
    camera: str | None = None,
    skin: str | None = None,
    forward: ArrayLike | None = None,
    name: str | None = None,
    mesh_folder: str | Path | None = None,
) -> Proposal:
    """Proposes a body: a robot that touches its face.

    Args:
        robot: The robot.
        hand: The link that touches.
        camera: The link that carries the eye; None: the first whose name speaks of an eye, a camera or a head.
        skin: The link that bears the skin; None: the camera's, or the nearest above it that is as large as a face.
        forward: (3,) where the robot looks at home, in the root; None: along x, to the side where the hand moves.
        name: The body's; None: the robot's.
        mesh_folder: Where meshes may lie, subfolders included; None: where the robot says.

    Returns:
        The body, why it is as it is, and what keeps it from working.

    Raises:
        UnknownName: No such link.
        InvalidConfig: No link named after an eye or a head, no joint between skin and hand, or a forward direction that
            is none.
        InvalidGeometry: A link without any shape for a skin.
        Unreachable: The hand gets nowhere near the face; says by how much.
    """
    folder = None if mesh_folder is None else Path(mesh_folder)
    robot.check_link(hand)
    said: list[str] = []
    try:
        return _proposed(robot, hand, camera, skin, forward, name, folder, said)
    except BodyImageKinError as problem:
        problem.add_note("\n".join(said))
        raise


def _proposed(
    robot: Robot, hand: str, camera: str | None, skin: str | None, forward: ArrayLike | None, name: str | None,
    folder: Path | None, said: list[str],
) -> Proposal:  # fmt: skip
    eye = _eye_link(robot, camera, said)
    face = _skin_link(robot, eye, skin, folder, said)
    joints = _joints(robot, hand, face, said)
    axes = _axes(robot, hand, joints, forward, said)
    palm = _hand(robot, hand, folder, said)
    home = torch.zeros(robot.n, dtype=torch.float64).clamp(robot.lower, robot.upper)
    root_T_face, root_T_eye = (kinematics(robot).pose(home, link).numpy() for link in (face, eye))
    hulls = Hulls(robot, joints, folder)
    wide = VirtualScreen(distance=0.04, near=1e-4, half_angle=math.radians(80.0))
    for share in _SMALLER:
        of_this = list[str]()
        patch = _patch(robot, face, _tidy(root_T_face[:3, :3].T @ axes), folder, share, of_this)
        optical = _optical_centre(patch, root_T_face, root_T_eye, axes, of_this)
        first = Embodiment.build(
            robot, joints=joints, hand=palm, camera=Camera(eye, optical, wide), skin=patch, home=robot.named(home),
            name=robot.name if name is None else name,
        )  # fmt: skip
        body, all_reached = _with_eye(_at_home(first, hulls, of_this), of_this)
        if all_reached:
            break
    said.extend(of_this)
    return Proposal(body, tuple(said), (*check_embodiment(body, paper=True, mesh_folder=folder), *_hit(body, hulls)))


# Links and joints -----------------------------------------------------------------------------------------------------


def _eye_link(robot: Robot, camera: str | None, said: list[str]) -> str:
    if camera is not None:
        return robot.check_link(camera)
    for part in _EYES:
        named = [
            link for link in robot.link_names if part in link.lower() and not any(one in link.lower() for one in _ARMS)
        ]
        if named:
            # Of several the outermost one with a shape: necks and mounts are named after heads too.
            link = max(named, key=lambda one: (_has_shape(robot, one), len(robot.path(one))))
            said.append(f"eye: on link '{link}', by its name; name another with --camera")
            return link
    raise InvalidConfig(
        f"no link of robot '{robot.name}' is named after an eye, a camera or a head; name one as camera, of "
        f"{', '.join(robot.link_names[:12])}{' ...' if len(robot.link_names) > 12 else ''}"
    )


def _has_shape(robot: Robot, link: str) -> bool:
    return bool(robot.geometry[link].collisions or robot.geometry[link].visuals)


def _skin_link(robot: Robot, eye: str, skin: str | None, folder: Path | None, said: list[str]) -> str:
    if skin is not None:
        return robot.check_link(skin)
    problems: list[str] = []
    for link in (eye, *(joint.parent for joint in reversed(robot.path(eye)))):
        corners = vertices_of(robot, link, folder, problems)
        if corners and float(np.sort(np.ptp(np.concatenate(corners), axis=0))[1]) >= _FACE:
            said.append(f"skin: on link '{link}', the nearest to the eye that is as large as a face")
            return link
    raise InvalidGeometry(
        problems[0]
        if problems
        else f"neither link '{eye}' nor any above it has a shape as large as a face; name one as skin"
    )


def _joints(robot: Robot, hand: str, face: str, said: list[str]) -> tuple[str, ...]:
    """Joints from the nearest common ancestor of hand and skin to the hand."""
    shared = {joint.name for joint in robot.path(face)}
    branch = [joint for joint in robot.path(hand) if joint.name not in shared]
    felt = tuple(dict.fromkeys(robot.source_of(joint.name)[0] for joint in branch if joint.kind != "fixed"))
    if not felt:
        raise InvalidConfig(f"no joint moves link '{hand}' against link '{face}'; name another hand")
    said.append(f"joints: the {len(felt)} from link '{branch[0].parent}', which hand and skin share, to the hand")
    return felt


def _axes(
    robot: Robot, hand: str, joints: tuple[str, ...], forward: ArrayLike | None, said: list[str]
) -> Float[np.ndarray, "3 3"]:
    """Columns right, down, forward of the robot, in its root, which stands upright."""
    up = np.array([0.0, 0.0, 1.0])
    if forward is None:
        moving = robot.subtree([hand], joints=joints)
        poses = kinematics(moving).pose(moving.sample(_DRAWN, seed=0), hand)[:, :3, 3].numpy()
        shoulder = next(joint for joint in moving.path(hand) if joint.kind != "fixed").child
        at = kinematics(moving).pose(torch.zeros(moving.n, dtype=torch.float64), shoulder)[:3, 3].numpy()
        ahead = np.array([1.0 if poses[:, 0].mean() >= at[0] else -1.0, 0.0, 0.0])
        said.append(f"forward: {'' if ahead[0] > 0 else '-'}x of the root, to where the hand moves most")
    else:
        ahead = as_float_array(forward, "forward", shapes=((3,),), error=InvalidConfig)
        ahead = ahead - (ahead @ up) * up
        if not np.linalg.norm(ahead) > 1e-9:
            raise InvalidConfig("forward: give a direction that is not vertical")
        ahead = ahead / np.linalg.norm(ahead)
    right = np.cross(ahead, up)
    return np.stack([right, -up, ahead], axis=1)


def _tidy(rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """The same rotation; one along the axes to a milliradian exactly so."""
    along = rotation.round() + 0.0
    return along if np.abs(rotation - along).max() < 1e-3 else rotation


# Hand, skin and eye ---------------------------------------------------------------------------------------------------


def _hand(robot: Robot, link: str, folder: Path | None, said: list[str]) -> Hand:
    """A ball in the middle of what the hand's link is made of."""
    corners = vertices_of(robot, link, folder)
    if not corners:
        said.append(f"hand: link '{link}' has no shape that can be read: a ball of 2 cm about its origin")
        return Hand(link, radius=0.02)
    low, high = np.concatenate(corners).min(0), np.concatenate(corners).max(0)
    radius = round(float(np.clip((high - low).min() / 2, *_RADIUS)), 3)
    said.append(f"hand: a ball of {1e3 * radius:.3g} mm in the middle of what link '{link}' is made of")
    return Hand(link, np.round((low + high) / 2, 4), radius)


def _patch(
    robot: Robot, link: str, axes: Float[np.ndarray, "3 3"], folder: Path | None, most: float, said: list[str]
) -> Skin:
    """The paper's grid on the front of a link, as large as the link allows.

    Args:
        robot: The robot.
        link: The link that bears the skin.
        axes: Columns right, down, forward, in the link.
        folder: Where meshes may lie.
        most: Share of that to begin with: the hand may not reach all of it.
        said: Remarks.
    """
    problems: list[str] = []
    parts = vertices_of(robot, link, folder, problems)
    if not parts:
        raise InvalidGeometry(problems[0] if problems else f"link '{link}' has no shape; name another link as skin")
    seen = np.concatenate(parts) @ axes
    front = seen[seen[:, 2] >= np.median(seen[:, 2])]
    low, high = front.min(0), front.max(0)
    centre = np.array([*(low[:2] + high[:2]) / 2, high[2] + 0.01])
    largest = np.minimum(_SHARE * (high - low)[:2], _LARGEST_PATCH)
    around = _cylinder(low, high, centre, axes)
    for on, of in (
        (None, f"the front of link '{link}'"),
        (around, f"a cylinder around link '{link}', whose front has holes"),
    ):
        for share in (1.0, 0.8, 0.64, 0.5):
            width, height = (most * share * largest).round(3).tolist()
            try:
                skin = Skin.grid(
                    robot, link, shape=_SHAPE, size=(height, width), centre=(axes @ centre).round(4) + 0.0,
                    forward=axes[:, 2], right=axes[:, 0], landmarks=_LANDMARKS, reference="right_eye",
                    eye="right_eye", on=on, mesh_folder=folder,
                )  # fmt: skip
            except (InvalidConfig, UnknownName):
                continue
            if skin.shape is not None and _straight(skin):
                said.append(
                    f"skin: {_SHAPE[0]} x {_SHAPE[1]} taxels on {1e3 * height:.0f} x {1e3 * width:.0f} mm of {of}"
                )
                return skin
    raise InvalidGeometry(f"no patch of {_SHAPE[0]} x {_SHAPE[1]} taxels finds room on the front of link '{link}'")


def _straight(skin: Skin) -> bool:
    """Whether each ray met the surface: taxels seen from the front are the grid."""
    if skin.layout is None:
        return False
    rows, columns = skin.layout.shape
    cells = np.stack(np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"), axis=-1).reshape(-1, 2)
    aside = np.stack([skin.right, skin.down], axis=1)
    return bool(np.allclose(skin.layout.points(cells.astype(float)) @ aside, skin.link_positions @ aside, atol=1e-9))


def _cylinder(
    low: Float[np.ndarray, "3"],
    high: Float[np.ndarray, "3"],
    centre: Float[np.ndarray, "3"],
    axes: Float[np.ndarray, "3 3"],
) -> Collision:
    """An upright cylinder as wide as what has these bounds along right, down and forward, and as far in front."""
    radius = float((high - low)[0]) / 2
    place = axes @ np.array([centre[0], centre[1], high[2] - radius])
    upright = np.stack([axes[:, 2], -axes[:, 0], -axes[:, 1]], axis=1)
    angles = scipy.spatial.transform.Rotation.from_matrix(upright).as_euler("xyz")
    roll, pitch, yaw = angles.tolist()
    x, y, z = (place.round(4) + 0.0).tolist()
    return Collision(Cylinder(round(radius, 4), round(float((high - low)[1]), 4)), (x, y, z), (roll, pitch, yaw))


def _optical_centre(
    skin: Skin,
    root_T_face: Float[np.ndarray, "4 4"],
    root_T_eye: Float[np.ndarray, "4 4"],
    axes: Float[np.ndarray, "3 3"],
    said: list[str],
) -> Float[np.ndarray, "4 4"]:
    """link_T_camera of an eye behind the face, that looks forward."""
    place = skin.link_positions[skin.landmarks["right_eye"]]
    rearmost = float((skin.link_positions @ skin.forward).min())
    depth = max(float(place @ skin.forward) - rearmost, 0.0) + _HIDDEN
    pose = np.eye(4)
    pose[:3, :3] = axes
    pose[:3, 3] = root_T_face[:3, :3] @ (place - depth * skin.forward) + root_T_face[:3, 3]
    found = np.linalg.inv(root_T_eye) @ pose
    found[:3, :3], found[:3, 3] = _tidy(found[:3, :3]), found[:3, 3].round(4) + 0.0
    said.append(
        f"eye: the paper's, {1e3 * _HIDDEN:.0f} mm behind the rearmost taxel and behind landmark right_eye, "
        f"{1e3 * float(np.linalg.norm(found[:3, 3])):.0f} mm from the origin of its link: an eye in front of the face "
        "would see the hand that touches"
    )
    return found


# Home, and what the eye sees ------------------------------------------------------------------------------------------


def _at_home(body: Embodiment, hulls: Hulls, said: list[str]) -> Embodiment:
    """The same body with its hand in front of the face: clear of collisions, far from its joint limits."""
    lower, upper = body.felt_robot.lower, body.felt_robot.upper
    finite = lower.isfinite() & upper.isfinite()
    low, high = torch.where(finite, lower, -torch.pi / 2), torch.where(finite, upper, torch.pi / 2)
    engine = torch.quasirandom.SobolEngine(body.p)  # type: ignore[no-untyped-call]
    shares = torch.cat([torch.full((1, body.p), 0.5), 0.15 + 0.7 * engine.draw(_STARTS)]).double()
    starts = [body.felt_home, *(low + shares * (high - low))]
    gap = math.inf
    for distance in _IN_FRONT:
        target = body.touch_centres([body.require_skin().middle], distance)
        tried: list[tuple[int, float, Tensor]] = []
        for start in starts:
            q, reached = replace(body, home=body.full_posture(start)).reach(target)
            gap = min(gap, float(torch.linalg.vector_norm(body.hand_in_front_and_jacobian(q)[0] - target)))
            if not bool(reached.all()):
                # It has been looked for from all over the joint space already.
                break
            if bool(body.visible(q[0])):
                hits = len(hulls.collisions(body.full_posture(q[0])))
                margin = float(torch.minimum((q[0] - low) / (high - low), (high - q[0]) / (high - low)).min())
                tried.append((hits, -round(margin, 3), q[0]))
        if tried:
            best = min(tried, key=lambda one: one[:2])
            said.append(
                f"home: the hand {1e3 * distance:.0f} mm in front of the middle taxel, found by inverse kinematics"
            )
            near = torch.round(best[2], decimals=3).clamp(lower, upper)
            values = dict(zip(body.joints, near.tolist(), strict=True))
            return _rebuilt(body, home=body.robot.named(body.home) | values)
    skin = body.require_skin()
    what = (
        f"gets no nearer than {1e3 * gap:.0f} mm to a place in front of link '{skin.link}'"
        if gap > 1e-3
        else f"gets in front of link '{skin.link}' only where its eye does not see it"
    )
    raise Unreachable(
        f"hand '{body.hand.link}' {what}; name another hand, skin or camera, or a forward direction", [skin.middle]
    )


def _with_eye(body: Embodiment, said: list[str]) -> tuple[Embodiment, bool]:
    """The same body with the numbers of its eye: the touching hand hidden, the screen where it touches.

    Returns:
        The body, and whether its hand reaches every taxel.
    """
    centres = body.touch_centres(np.arange(body.require_skin().count))
    q, reached = body.reach(centres)
    if not bool(reached.any()):
        return body, False
    depths = body.hand_in_camera(q[reached])[:, 2]
    near = round(float(depths.max()) + _CLEAR, 3)
    screen = VirtualScreen(round(float(depths.median()), 3), near, math.radians(60.0))
    said.append(
        f"eye: virtual screen at {1e3 * screen.distance:.0f} mm, the middle depth of a hand that touches; nothing is "
        f"seen nearer than {1e3 * near:.0f} mm, so that no touch is"
    )
    return _rebuilt(body, camera=Camera(body.camera.link, body.camera.link_T_camera, screen)), bool(reached.all())


def _rebuilt(body: Embodiment, *, home: Mapping[str, float] | None = None, camera: Camera | None = None) -> Embodiment:
    return Embodiment.build(
        body.robot,
        joints=body.joints,
        hand=body.hand,
        camera=camera or body.camera,
        skin=body.skin,
        home=body.robot.named(body.home) if home is None else home,
        name=body.name,
    )


def _hit(body: Embodiment, hulls: Hulls) -> tuple[Finding, ...]:
    """Collisions at home and while touching, as findings."""
    found = []
    at_home = hulls.collisions(body.home)
    if at_home:
        pairs = ", ".join(f"'{one}' and '{other}'" for one, other in at_home[:3])
        found.append(Finding("note", "joints", f"at home {pairs} overlap (convex hulls); look at the picture"))
    return tuple(found)
