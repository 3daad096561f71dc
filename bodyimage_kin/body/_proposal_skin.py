"""The hand, the patch of skin and the paper's eye on links of an unknown robot."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import scipy.spatial
from jaxtyping import Float

from bodyimage_kin.body.collisions import vertices_of
from bodyimage_kin.body.hand import Hand
from bodyimage_kin.body.skin import Skin
from bodyimage_kin.errors import InvalidConfig, InvalidGeometry, UnknownName
from bodyimage_kin.robot import Robot
from bodyimage_kin.robot.geometry import Collision, Cylinder

__all__ = ["balls_of", "face_patch", "optical_centre", "tidy"]

_SHAPE = (21, 21)
_LANDMARKS = {"left_eye": (6, 3), "right_eye": (6, 17), "nose": (10, 10), "mouth": (15, 10)}
"""Of the infant's face, which has the paper's number of taxels."""
_HIDDEN = 0.02
"""How far behind the face the paper's optical centre lies on the infant [m]."""
_SHARE, _LARGEST_PATCH = 0.6, 0.12
_RADIUS = (0.01, 0.04)


def tidy(rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """The same rotation; one along the axes to a milliradian exactly so."""
    along = rotation.round() + 0.0
    return along if np.abs(rotation - along).max() < 1e-3 else rotation


def balls_of(robot: Robot, link: str, folder: Path | None) -> Iterator[tuple[Hand, str]]:
    """A ball in the middle of what the hand's link is made of, then one at its outer end; each with where it is."""
    parts = vertices_of(robot, link, folder)
    if not parts:
        yield (
            Hand(link, radius=0.02),
            f"hand: link '{link}' has no shape that can be read: a ball of 2 cm about its origin",
        )
        return
    low, high = np.concatenate(parts).min(0), np.concatenate(parts).max(0)
    radius, middle = round(float(np.clip((high - low).min() / 2, *_RADIUS)), 3), (low + high) / 2
    size = f"hand: a ball of {1e3 * radius:.3g} mm"
    yield Hand(link, np.round(middle, 4), radius), f"{size} in the middle of what link '{link}' is made of"
    # Hands are drawn from the wrist outward: their origin is where they begin.
    axis = int(np.argmax(np.abs(middle)))
    outward = np.copysign(1.0, middle[axis])
    end = middle.copy()
    end[axis] = (high if outward > 0 else low)[axis] - outward * radius
    if abs(end[axis]) > abs(middle[axis]):
        yield (
            Hand(link, np.round(end, 4), radius),
            f"{size} at the outer end of link '{link}', for its middle gets less far",
        )


def face_patch(
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
    if (np.ptp(front, axis=0)[:2] < 0.5 * np.ptp(seen, axis=0)[:2]).any():
        # The foremost corners of a slanted plate are one of its edges.
        front = seen
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


def optical_centre(
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
    found[:3, :3], found[:3, 3] = tidy(found[:3, :3]), found[:3, 3].round(4) + 0.0
    said.append(
        f"eye: the paper's, {1e3 * _HIDDEN:.0f} mm behind the rearmost taxel and behind landmark right_eye, "
        f"{1e3 * float(np.linalg.norm(found[:3, 3])):.0f} mm from the origin of its link: an eye in front of the face "
        "would see the hand that touches"
    )
    return found
