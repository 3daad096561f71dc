"""The robot of the recordings: its rows of Denavit and Hartenberg, its eyes, its markers, and how its files are read.

Data and nominal measures of Stepanova, Rozlivek, Puciow, Krsek, Pajdla and Hoffmann, "Automatic self-contained
calibration of an industrial dual-arm robot with cameras using self-contact, planar constraints, and self-observation"
(2022). Files from ``ctu-vras/multirobot-calibration`` on GitHub.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from pathlib import Path

import numpy as np
import scipy.io
import torch
import xarray as xr

import bodyimage_kin as bk
from bodyimage_kin.robot.transforms import rpy_matrix, transform

TILT = np.radians(15.0)
JOINTS = ("S", "L", "U", "R", "B", "T")
ROWS = (
    # a [m], d [m], alpha, offset; classic. The first is the external axis, which both arms and both eyes hang on.
    (0.0, -0.263, TILT, -pi / 2),
    (0.150, 1.4159, -pi / 2, 0.0),
    (0.614, 0.0, pi, -pi / 2),
    (0.200, 0.0, -pi / 2, 0.0),
    (0.0, -0.640, pi / 2, 0.0),
    (0.030, 0.0, pi / 2, -pi / 2),
    (0.0, 0.200, 0.0, 0.0),
)
FLANGE = (0.0, 0.354, 0.0, 0.0)
"""The middle of the marker body."""
REFLECTOR = (0.045, 0.245, 0.0, -0.38)
"""The tracker's reflector."""
EYES = {
    1: (
        ((0.0741, 1.8034, -2.5086, -2.7753), (0.0, -0.5670, 0.0, 0.2863)),
        bk.Pinhole(8185.397, 8170.401, 2009.318, 2963.960, distortion=(-0.021, -0.206, -0.002, -0.001, 0.719)),
    ),
    2: (
        ((0.2315, 1.8602, 2.5486, 0.0860), (0.0, -0.4982, 0.0, -3.0618)),
        bk.Pinhole(8110.478, 8098.218, 1949.921, 2991.727, distortion=(-0.023, -0.213, -0.001, -0.001, 0.662)),
    ),
}
_NUMBERS = """
.0320 0 -.04189  .00989 .03043 -.04189  -.02589 .01881 -.04189  -.02589 -.01881 -.04189  .00989 -.03043 -.04189
.05178 0 -.00989  .016 .04924 -.00989  -.04189 .03043 -.00989  -.04189 -.03043 -.00989  .016 -.04924 -.00989
.04189 -.03043 .00989  .04189 .03043 .00989  -.016 .04924 .00989  -.05178 0 .00989  -.016 -.04924 .00989
.02589 -.01881 .04189  .02589 .01881 .04189  .00989 .03043 .04189  -.0320 0 .04189  .00989 -.03043 .04189
"""
FACES = np.array(_NUMBERS.split(), dtype=np.float64).reshape(20, 3)
"""Centres of the faces of the icosahedron, in the flange [m]."""


def row_transform(a: float, d: float, alpha: float, offset: float) -> np.ndarray:
    """One classic row at zero."""
    turned = transform(rpy_matrix((0.0, 0.0, offset)), (0.0, 0.0, d))
    return np.asarray(turned @ transform(rpy_matrix((alpha, 0.0, 0.0)), (a, 0.0, 0.0)))


def robot(last: tuple[float, float, float, float]) -> bk.Robot:
    """The right arm, its last row fixed."""
    kinds = ["revolute"] * 7 + ["fixed"]
    return bk.Robot.from_dh([*ROWS, last], kinds=kinds, joints=("E", *JOINTS, "tool"), name="motoman")


def seen_by(eye: int) -> bk.Embodiment:
    """The right arm with the marker body, before one of the eyes that the external axis carries."""
    chain, lens = EYES[eye]
    pose = row_transform(*chain[0]) @ row_transform(*chain[1])
    return bk.Embodiment.build(
        robot(FLANGE), joints=JOINTS, hand=bk.Hand("link8"), camera=bk.Camera("E_turned", pose, lens)
    )


def tracked(exp: xr.Dataset) -> bk.Embodiment:
    """The right arm with the reflector, before a tracker that stands where the nominal arm best agrees with it."""
    arm = robot(REFLECTOR)
    body = bk.Embodiment.build(
        arm, joints=JOINTS, hand=bk.Hand("link8"), camera=bk.Camera(arm.root, np.eye(4), bk.Tracker())
    )
    in_root, in_tracker = body.hand_image(exp["q"].values[0]).numpy(), exp["hand_image"].values[0]
    middle, there = in_root.mean(0), in_tracker.mean(0)
    U, _, V = np.linalg.svd((in_root - middle).T @ (in_tracker - there))
    rotation = U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V
    pose = transform(rotation, middle - rotation @ there)
    return bk.Embodiment.build(
        arm, joints=JOINTS, hand=bk.Hand("link8"), camera=bk.Camera(arm.root, torch.from_numpy(pose), bk.Tracker())
    )


def _rows(folder: Path, name: str) -> np.ndarray:
    found = scipy.io.loadmat(folder / "motoman" / f"{name}_dataset.mat")["dataset"]
    return np.asarray(found[found[:, 2] == 1], dtype=np.float64)


def tracker_points(folder: Path, name: str) -> xr.Dataset:
    """Poses of the right arm and the reflector's place in the tracker's frame [m], in blocks of successive poses."""
    rows = _rows(folder, name)
    rows = rows[np.isfinite(rows[:, 19:22]).all(1)]
    rows = rows[np.unique(rows[:, 0], return_index=True)[1]]
    return bk.recording(
        q=rows[:, 7:13],
        hand_image=rows[:, 19:22],
        joints=list(JOINTS),
        order="scattered",
        unit="m",
        block=np.arange(len(rows)) * BLOCKS // len(rows),
    )


BLOCKS = 20
"""Runs of successive poses that are held out, and resampled, as one."""


@dataclass(frozen=True, eq=False)
class Markers:
    """What one eye saw of the marker body, a row a face.

    Attributes:
        q: (rows, 6) [rad].
        image: (rows, 2) [px].
        face: (rows,) from 0.
        pose: (rows,) number of the pose.
    """

    q: np.ndarray
    image: np.ndarray
    face: np.ndarray
    pose: np.ndarray

    def of(self, face: int) -> Markers:
        """One face alone."""
        kept = self.face == face
        return Markers(self.q[kept], self.image[kept], self.face[kept], self.pose[kept])

    def recording(self) -> xr.Dataset:
        """All rows, each with the point of the hand that it shows."""
        return bk.recording(
            q=self.q,
            hand_image=self.image,
            joints=list(JOINTS),
            order="scattered",
            unit="px",
            hand_offset=FACES[self.face],
            block=np.unique(self.pose, return_inverse=True)[1] % BLOCKS,
        )


def markers(folder: Path, name: str, eye: int) -> Markers:
    """The marker body in the image of an eye."""
    rows = _rows(folder, name)
    rows = rows[(rows[:, 3] == eye) & np.isfinite(rows[:, 4:6]).all(1)]
    return Markers(rows[:, 7:13], rows[:, 4:6], rows[:, 1].astype(int) - 1, rows[:, 0].astype(int))
