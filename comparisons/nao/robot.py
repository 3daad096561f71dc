"""The constants of NAO: its tables of Denavit and Hartenberg, where its skins are mounted, and its recordings.

The arm, the mounts and the triangles are those published with the recordings (``ctu-vras/multirobot-calibration`` on
GitHub); the elbow's offset of 15 mm stands before ElbowYaw, as in the public URDF.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import xarray as xr
from scipy.spatial.transform import Rotation

import bodyimage_kin as bk
from bodyimage_kin.body import Skin, read_nao_taxels

SIDE = {"left": 1.0, "right": -1.0}
JOINTS = ("ShoulderPitch", "ShoulderRoll", "ElbowYaw", "ElbowRoll", "WristYaw")
NECK = [(0, 0.1265, 0, 0), (0, 0, -pi / 2, 0), (0, 0, 0, 0)]
"""Rows of the neck: a constant one, HeadYaw, HeadPitch."""
PATCHES = {
    "torso": ((*range(6), *range(8, 16)), (16, 17, 18, *range(24, 32))),
    "head": ((*range(9), 12, 13, 15), (*range(16, 25), 28, 29, 31)),
}
MOUNTS = {
    "torso": (0.0646, 0.0006, 0.0468, -0.0012, 0.0427, 0.0005),
    "head": (0.0597, -0.0704, -0.0013, 1.5512, -0.2112, -0.2574),
}
TIP = (0.0, 0.0, 0.06)
"""Where the finger's tip is drawn, in the last frame of the arm [m]."""
EYE_BEHIND, SCREEN = 0.04, 0.1
"""The paper's virtual eye: so far behind the rearmost taxel, its screen so far in front of it [m]."""


@dataclass(frozen=True)
class Touched:
    """One published recording.

    Attributes:
        part: The part that is touched.
        side: Of the arm whose finger touches.
    """

    part: str
    side: str

    @property
    def joints(self) -> list[str]:
        """Felt joints: of the arm, and of the neck where the head is touched."""
        neck = ["HeadYaw", "HeadPitch"] if self.part == "head" else []
        return [self.side[0].upper() + name for name in JOINTS] + neck

    @property
    def file(self) -> str:
        """Its name."""
        return f"{self.part}_{self.side}Finger.mat"


TORSO, HEAD = Touched("torso", "right"), Touched("head", "left")


def arm(side: str) -> list[tuple[float, float, float, float]]:
    """Rows (a, d, alpha, offset) of an arm; the first is the constant shoulder."""
    left = SIDE[side]
    return [
        (0, 0.1, -pi / 2, 0), (0, 0.098 * left, pi / 2, 0), (0.015 * left, 0, pi / 2, pi / 2),
        (0, 0.105, -pi / 2, 0), (0, 0, pi / 2, 0), (0, 0.1137, -pi / 2, pi),
    ]  # fmt: skip


def robot_of(what: Touched) -> bk.Robot:
    """The arm on the torso, and the head beside it where that is touched."""
    joints = ["shoulder", *what.joints[:5]]
    links = ["torso", *(f"arm{row}" for row in range(1, 6)), "hand"]
    arms = bk.Robot.from_dh(arm(what.side), joints=joints, links=links, name=f"nao_{what.part}")
    if what.part == "torso":
        return arms
    neck = bk.Robot.from_dh(
        NECK, joints=["neck", "HeadYaw", "HeadPitch"], links=["torso", "neck1", "neck2", "head"], name="nao"
    )
    inside = neck.to_urdf().split(">", 1)[1].rpartition("</robot>")[0].replace('<link name="torso"/>', "", 1)
    return bk.Robot.from_urdf(arms.to_urdf().replace("</robot>", inside + "</robot>"))


def nominal(what: Touched, data: Path) -> bk.Embodiment:
    """The body as it is drawn, with the paper's virtual eye behind the skin; its home is the median of the touches."""
    x, y, z, *turned = MOUNTS[what.part]
    mount = np.eye(4)
    mount[:3, :3], mount[:3, 3] = Rotation.from_rotvec(turned).as_matrix(), (x, y, z)
    table = read_nao_taxels(data / "nao" / "Transformations" / f"{what.part}.txt", PATCHES[what.part])
    skin = table.skin(what.part, mount)
    angles = [[one["angles"][joint] for joint in what.joints] for one in _records(what, data)]
    return bk.Embodiment.build(
        robot_of(what), joints=what.joints, hand=bk.Hand("hand", offset=TIP), camera=eye(skin), skin=skin,
        name=f"nao_{what.part}", home=dict(zip(what.joints, np.median(angles, axis=0).tolist(), strict=True)),
    )  # fmt: skip


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
    """The recorded touches: postures and active taxels, in so many contiguous blocks."""
    records = _records(what, data)
    skin = body.require_skin()
    felt = [[t for t in skin.taxels_of(np.atleast_1d(one["activatedTaxels"])) if t >= 0] for one in records]
    q = [[one["angles"][joint] for joint in body.joints] for one in records]
    block = np.arange(len(records)) * blocks // len(records)
    return bk.recording(q=q, touched=felt, joints=body.joints, order="scattered", block=block, origin=what.file)


def _records(what: Touched, data: Path) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = scipy.io.loadmat(data / "nao" / what.file, simplify_cells=True)[what.part]
    return found
