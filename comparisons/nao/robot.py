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
PATCHES = {
    "torso": ((*range(6), *range(8, 16)), (16, 17, 18, *range(24, 32))),
}
MOUNTS = {
    "torso": (0.0646, 0.0006, 0.0468, -0.0012, 0.0427, 0.0005),
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
    def file(self) -> str:
        """Its name."""
        return f"{self.part}_{self.side}Finger.mat"


TORSO = Touched("torso", "right")


def arm(side: str) -> list[tuple[float, float, float, float]]:
    """Rows (a, d, alpha, offset) of an arm; the first is the constant shoulder."""
    left = SIDE[side]
    return [
        (0, 0.1, -pi / 2, 0), (0, 0.098 * left, pi / 2, 0), (0.015 * left, 0, pi / 2, pi / 2),
        (0, 0.105, -pi / 2, 0), (0, 0, pi / 2, 0), (0, 0.1137, -pi / 2, pi),
    ]  # fmt: skip


def nominal(what: Touched, data: Path) -> bk.Embodiment:
    """The body as it is drawn, with the paper's virtual eye behind the skin."""
    initial = what.side[0].upper()
    joints = [initial + name for name in JOINTS]
    robot = bk.Robot.from_dh(arm(what.side), joints=["shoulder", *joints], name=f"nao_{what.side}_arm")
    x, y, z, *turned = MOUNTS[what.part]
    mount = np.eye(4)
    mount[:3, :3], mount[:3, 3] = Rotation.from_rotvec(turned).as_matrix(), (x, y, z)
    table = read_nao_taxels(data / "nao" / "Transformations" / f"{what.part}.txt", PATCHES[what.part])
    skin = table.skin(robot.root, mount)
    return bk.Embodiment.build(
        robot, joints=joints, hand=bk.Hand(robot.link_names[-1], offset=TIP), camera=eye(skin), skin=skin,
        name=f"nao_{what.part}", home=HOME[what.side],
    )  # fmt: skip


HOME = {
    "right": {"RShoulderPitch": 0.8, "RElbowYaw": 0.5, "RElbowRoll": 1.3},
    "left": {"LShoulderPitch": 0.8, "LElbowYaw": -0.5, "LElbowRoll": -1.3},
}


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
    records: list[dict[str, Any]] = scipy.io.loadmat(data / "nao" / what.file, simplify_cells=True)[what.part]
    skin = body.require_skin()
    felt = [[t for t in skin.taxels_of(np.atleast_1d(one["activatedTaxels"])) if t >= 0] for one in records]
    q = [[one["angles"][joint] for joint in body.joints] for one in records]
    block = np.arange(len(records)) * blocks // len(records)
    return bk.recording(q=q, touched=felt, joints=body.joints, order="scattered", block=block, origin=what.file)
