"""The constants of NAO: its tables of Denavit and Hartenberg, where its skins are mounted, and its recordings.

The arm, the mounts and the triangles are those published with the recordings (``ctu-vras/multirobot-calibration`` on
GitHub); the elbow's offset of 15 mm stands before ElbowYaw, as in the public URDF.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import xarray as xr
from jaxtyping import Float
from scipy.spatial.transform import Rotation

import bodyimage_kin as bk
from bodyimage_kin.body import Skin, read_nao_taxels
from bodyimage_kin.body.clusters import touched_place

SIDE = {"left": 1.0, "right": -1.0}
JOINTS = ("ShoulderPitch", "ShoulderRoll", "ElbowYaw", "ElbowRoll", "WristYaw")
NECK = [(0, 0.1265, 0, 0), (0, 0, -pi / 2, 0), (0, 0, 0, 0)]
"""Rows of the neck: a constant one, HeadYaw, HeadPitch."""
_ARM = ((*range(16),), (19, 20, 21, 22, 23, 25, 26, 31))
PATCHES = {
    "rightArm": _ARM,
    "leftArm": _ARM,
    "torso": ((*range(6), *range(8, 16)), (16, 17, 18, *range(24, 32))),
    "head": ((*range(9), 12, 13, 15), (*range(16, 25), 28, 29, 31)),
}
MOUNTS = {
    "torso": (0.0646, 0.0006, 0.0468, -0.0012, 0.0427, 0.0005),
    "head": (0.0597, -0.0704, -0.0013, 1.5512, -0.2112, -0.2574),
    "rightArm": (-0.0292, -0.0300, -0.0222, -0.5452, 1.7668, 1.9904),
    "leftArm": (0.0295, -0.0682, -0.0259, 1.5291, 0.5315, -0.4926),
}
SLEEVE = (0, 0.05595, -pi / 2, pi)
"""Row after WristYaw on which the skin of the arm hangs, in place of the arm's last one."""
TIP = (0.0, 0.0, 0.06)
"""Where the finger's tip is drawn, in the last frame of the arm [m]."""
NEAR = 0.01
"""Places on the arm's skin nearer than this to a point count as that point [m]: a taxel and a half."""
EYE_BEHIND, SCREEN = 0.04, 0.1
"""The paper's virtual eye: so far behind the rearmost taxel, its screen so far in front of it [m]."""


@dataclass(frozen=True)
class Touched:
    """One published recording.

    Attributes:
        part: The part that is touched.
        side: Of the arm that touches.
        by: What of it touches: its ``"finger"`` or its own skin, ``"arm"``.
    """

    part: str
    side: str
    by: str = "finger"

    @property
    def joints(self) -> list[str]:
        """Felt joints: of the arm, and of the neck where the head is touched."""
        neck = ["HeadYaw", "HeadPitch"] if self.part == "head" else []
        return [self.side[0].upper() + name for name in JOINTS] + neck

    @property
    def file(self) -> str:
        """Its name."""
        return f"{self.part}_{self.side}Finger.mat" if self.by == "finger" else f"{self.side}Arm_{self.part}.mat"

    @property
    def circle(self) -> bk.motions.Circle:
        """What is learned from: the paper's circle, or what of it a wrist at the chest reaches, at equal time."""
        small = self.by == "arm" and self.part == "torso"
        return bk.motions.Circle(radius=0.02, distance=0.02, turns=7.5) if small else bk.motions.Circle()


TORSO, HEAD = Touched("torso", "right"), Touched("head", "left")
BY_ARM = {
    f"{part}_by_{side}_arm": Touched(part, side, "arm") for part in ("torso", "head") for side in ("right", "left")
}
RECORDINGS = {"torso": TORSO, "head": HEAD} | BY_ARM
"""What each page is called, and its recording."""


def arm(side: str, by: str = "finger") -> list[tuple[float, float, float, float]]:
    """Rows (a, d, alpha, offset) of an arm; the first is the constant shoulder, the last ends where ``by`` hangs."""
    left = SIDE[side]
    return [
        (0, 0.1, -pi / 2, 0), (0, 0.098 * left, pi / 2, 0), (0.015 * left, 0, pi / 2, pi / 2),
        (0, 0.105, -pi / 2, 0), (0, 0, pi / 2, 0), (0, 0.1137, -pi / 2, pi) if by == "finger" else SLEEVE,
    ]  # fmt: skip


def robot_of(what: Touched) -> bk.Robot:
    """The arm on the torso, and the head beside it where that is touched."""
    joints = ["shoulder", *what.joints[:5]]
    links = ["torso", *(f"arm{row}" for row in range(1, 6)), "hand"]
    arms = bk.Robot.from_dh(arm(what.side, what.by), joints=joints, links=links, name=f"nao_{what.part}")
    if what.part == "torso":
        return arms
    neck = bk.Robot.from_dh(
        NECK, joints=["neck", "HeadYaw", "HeadPitch"], links=["torso", "neck1", "neck2", "head"], name="nao"
    )
    inside = neck.to_urdf().split(">", 1)[1].rpartition("</robot>")[0].replace('<link name="torso"/>', "", 1)
    return bk.Robot.from_urdf(arms.to_urdf().replace("</robot>", inside + "</robot>"))


def skin_of(part: str, data: Path, link: str) -> Skin:
    """A published skin where it is mounted in a link."""
    x, y, z, *turned = MOUNTS[part]
    mount = np.eye(4)
    mount[:3, :3], mount[:3, 3] = Rotation.from_rotvec(turned).as_matrix(), (x, y, z)
    return read_nao_taxels(data / "nao" / "Transformations" / f"{part}.txt", PATCHES[part]).skin(link, mount)


def nominal(what: Touched, data: Path) -> bk.Embodiment:
    """The body as it is drawn, with the paper's virtual eye behind the skin; its home is the median of the touches.

    Its hand is the finger's tip, or the point of the arm's skin that touches most. That does not reach the middle of
    the skin: the place that it touches stands for it.
    """
    skin = skin_of(what.part, data, what.part)
    angles = [[one["angles"][joint] for joint in what.joints] for one in _records(what, data)]
    place = np.array(TIP)
    if what.by == "arm":
        places = touching_places(what, data)
        place = most_touching(places)
        near = np.flatnonzero(np.linalg.norm(places - place, axis=1) < NEAR)
        angles = [angles[row] for row in near]
        felt = np.stack([skin.link_positions[_active(skin, _records(what, data)[row])].mean(0) for row in near])
        away = np.linalg.norm(skin.link_positions - np.nanmedian(felt, axis=0), axis=1)
        skin = replace(skin, reference=int(away.argmin()))
    return bk.Embodiment.build(
        robot_of(what), joints=what.joints, hand=bk.Hand("hand", offset=place), camera=eye(skin), skin=skin,
        name=f"nao_{what.part}", home=dict(zip(what.joints, np.median(angles, axis=0).tolist(), strict=True)),
    )  # fmt: skip


def touching_places(what: Touched, data: Path) -> Float[np.ndarray, "touches 3"]:
    """Where the arm's skin felt each touch, as it is drawn in the hand's link [m]; NaN where it was in two places."""
    sleeve = skin_of(f"{what.side}Arm", data, "hand")
    places = np.full((len(_records(what, data)), 3), np.nan)
    for row, one in enumerate(_records(what, data, f"{what.side}Arm")):
        at = touched_place(sleeve.link_positions, np.array(_active(sleeve, one), dtype=np.int64))
        if at is not None:
            places[row] = sleeve.link_positions[at].mean(0)
    return places


def most_touching(places: Float[np.ndarray, "touches 3"]) -> Float[np.ndarray, "3"]:
    """Of places that touched [m], the one with most others within :data:`NEAR`."""
    known = places[np.isfinite(places).all(1)]
    near = np.linalg.norm(known[:, None] - known, axis=-1) < NEAR
    return np.asarray(known[near.sum(1).argmax()])


def eye(skin: Skin) -> bk.Camera:
    """The virtual eye, behind the rearmost taxel."""
    middle = skin.link_positions.mean(0)
    back = ((skin.link_positions - middle) @ skin.forward).min() - EYE_BEHIND
    pose = np.eye(4)
    pose[:3] = np.stack([skin.right, skin.down, skin.forward, middle + back * skin.forward], axis=1)
    return bk.Camera(skin.link, pose, bk.VirtualScreen(SCREEN, near=0.01, half_angle=1.4))


def seen_by(body: bk.Embodiment, camera: bk.Camera) -> bk.Embodiment:
    """The same body with another eye."""
    return replace(body, camera=camera)


def touches(what: Touched, body: bk.Embodiment, data: Path, blocks: int) -> xr.Dataset:
    """The recorded touches: postures and active taxels, in so many contiguous blocks.

    By the arm, ``hand_offset`` is where its own skin felt them; those that it felt in two places are left out.
    """
    records = _records(what, data)
    skin = body.require_skin()
    felt = [_active(skin, one) for one in records]
    q = [[one["angles"][joint] for joint in body.joints] for one in records]
    block = np.arange(len(records)) * blocks // len(records)
    offset = None if what.by == "finger" else touching_places(what, data)
    known = np.arange(len(records)) if offset is None else np.flatnonzero(np.isfinite(offset).all(1))
    return bk.recording(
        q=np.array(q)[known], touched=[felt[row] for row in known], joints=body.joints, order="scattered",
        block=block[known], hand_offset=None if offset is None else offset[known], origin=what.file,
    )  # fmt: skip


def _active(skin: Skin, record: dict[str, Any]) -> list[int]:
    """Taxels of a skin that a record says were active."""
    # With skin on skin, activatedTaxels is a count.
    ids = np.atleast_2d(record["activatedUn"])[:, 3] if "activatedUn" in record else record["activatedTaxels"]
    return [taxel for taxel in skin.taxels_of(np.atleast_1d(ids).astype(np.int64)) if taxel >= 0]


@lru_cache(maxsize=2)
def _file(path: Path) -> dict[str, Any]:
    found: dict[str, Any] = scipy.io.loadmat(path, simplify_cells=True)
    return found


def _records(what: Touched, data: Path, part: str | None = None) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = _file(data / "nao" / what.file)[part or what.part]
    return found
