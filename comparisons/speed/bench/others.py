"""What else costs time: long chains, hand images, maps, networks, streams."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import torch
import xarray as xr
from torch import Tensor

from bench.timing import quartiles, turns
from bodyimage_kin.backends import kinematics
from bodyimage_kin.body import Camera, Pinhole
from bodyimage_kin.body.file import load_embodiment
from bodyimage_kin.robot import Robot

_BATCH = 10_000


def growth(rounds: int) -> list[dict[str, Any]]:
    """Seconds a posture: by batch, by moving joints, by fixed links between seven joints."""
    rows = []
    cases = [("batch", batch, 7, 0, batch) for batch in (1, 10, 100, 1000, 10_000, 100_000)]
    cases += [("joints", joints, joints, 0, _BATCH) for joints in (1, 2, 4, 8, 16, 32, 64)]
    cases += [("fixed links", fixed, 7, fixed, _BATCH) for fixed in (0, 7, 28, 112)]
    for what, size, joints, fixed, batch in cases:
        kin = kinematics(_chain(joints, fixed), "numba")
        q = kin.robot.sample(batch)
        taken = turns({"numba": partial(kin.pose_and_jacobian, q, "end")}, rounds)["numba"]
        rows.append({"by": what, "size": size, "seconds_a_posture": [each / batch for each in quartiles(taken)]})
    return rows


def images(rounds: int) -> list[dict[str, Any]]:
    """The image Jacobian in one pass, of a lens in pixels too, by torch formulas, and a 6 x n Jacobian alone."""
    fused, plain = load_embodiment("infant", backend="numba"), load_embodiment("infant", backend="numba")
    # What is cached there is what would be built: None means that nothing does it in one pass.
    plain.__dict__["_sight"] = None
    q = fused.felt_home + 0.1 * (torch.rand(_BATCH, fused.p, generator=torch.manual_seed(0), dtype=torch.float64) - 0.5)
    lens = Pinhole(600.0, 600.0, 320.0, 240.0, distortion=(-0.1, 0.01, 1e-3, -1e-3, 2e-3))
    pixels = dataclasses.replace(fused, camera=Camera(fused.camera.link, fused.camera.link_T_camera, lens))
    work = {
        "image Jacobian, one pass": lambda: fused.hand_image_jacobian(q),
        "image Jacobian of a pinhole with distortion, one pass": lambda: pixels.hand_image_jacobian(q),
        "image Jacobian, from 6 x n ones": lambda: plain.hand_image_jacobian(q),
        "6 x n Jacobian alone": lambda: fused.kinematics.pose_and_jacobian(q, fused.hand.link),
    }
    return [{"what": name, "batch": _BATCH, "seconds": quartiles(taken)} for name, taken in turns(work, rounds).items()]


def maps(rounds: int) -> list[dict[str, Any]]:
    """Online steps of a 21 x 21 map in two dimensions, beside MiniSom's.

    The touch names the winner on the body image's maps; MiniSom searches for it. Its update alone, with winners given,
    is as much work as ours on one map; ours is on two.
    """
    from minisom import MiniSom

    from bodyimage_kin.body_image import BodyImage
    from bodyimage_kin.body_image.posture_som import PostureSOM

    steps, random = 8000, np.random.default_rng(0)
    image, q = random.uniform(-0.03, 0.03, (steps, 2)), random.uniform(-1.0, 1.0, (steps, 4))
    experience = xr.Dataset(
        {
            "q": (("trial", "time", "joint"), q[None]),
            "touched": (("trial", "time", "contact"), random.integers(0, 441, (1, steps, 1))),
            "hand_image": (("trial", "time", "axis"), image[None]),
        }
    )
    postures = PostureSOM.fit(q, seed=0)

    touched = dict(enumerate(divmod(taxel, 21) for taxel in experience.touched.values[0, :, 0].tolist()))

    def minisom(winners: dict[int, tuple[int, int]] | None = None) -> None:
        MiniSom(21, 21, 2, sigma=4.0, learning_rate=0.3, random_seed=0).train(image, steps, fixed_points=winners)

    work: dict[str, Callable[[], Any]] = {
        "both maps of the body image (21 x 21 and 8 x 8), winners given": lambda: BodyImage.learn(
            experience, image[None], seed=0, posture_som=postures
        ),
        "MiniSom (21 x 21), winners searched": minisom,
        "MiniSom (21 x 21), winners given": partial(minisom, touched),
    }
    return [{"what": name, "steps": steps, "seconds": quartiles(taken)} for name, taken in turns(work, rounds).items()]


def networks(rounds: int) -> list[dict[str, Any]]:
    """The paper's network on its visible circle, a hundred seeds of 500 descent steps."""
    from bodyimage_kin.estimators import PaperMLP
    from bodyimage_kin.recordings import experience, motions, simulate

    felt = experience(simulate(load_embodiment("infant", backend="numba"), motions.Circle(), seed=0))
    seeds = range(100)
    fit = partial(PaperMLP(steps=500).fit_many, [felt] * len(seeds), seeds)
    what = f"the paper's network: {len(seeds)} seeds, {felt.sizes['time'] - 1} samples"
    return [{"what": what, "steps": 500, "seconds": quartiles(turns({"fit": fit}, rounds, budget=10.0)["fit"])}]


def stream(postures: int) -> dict[str, Any]:
    """Jacobians of very many postures in constant memory."""
    body = load_embodiment("infant", backend="numba")
    kin, link = body.kinematics, body.hand.link
    q = kin.robot.sample(16384)

    def source() -> Iterator[Tensor]:
        for first in range(0, postures, len(q)):
            yield q[: postures - first]

    begin, wall = time.process_time(), time.perf_counter()
    seen = sum(len(pose) for pose, _ in kin.stream(source(), link))
    return {
        "postures": seen,
        "joints": kin.robot.n,
        "processor_seconds": time.process_time() - begin,
        "seconds": time.perf_counter() - wall,
    }


def _chain(joints: int, fixed: int) -> Robot:
    """A serial arm of turning joints, of the same length whatever their number, fixed links spread among them."""
    random = np.random.default_rng(0)
    kinds = [kind for index in range(joints) for kind in ["revolute", *["fixed"] * ((fixed + index) // joints)]]
    lines = ['<robot name="chain"><link name="link0"/>']
    for index, kind in enumerate(kinds, 1):
        child = "end" if index == len(kinds) else f"link{index}"
        xyz, rpy, axis = random.uniform(-1, 1, (3, 3))
        numbers = [" ".join(map(str, values)) for values in (xyz / len(kinds), rpy, axis)]
        moves = f'<axis xyz="{numbers[2]}"/><limit lower="-3" upper="3" effort="0" velocity="0"/>'
        lines.append(
            f'<link name="{child}"/><joint name="joint{index}" type="{kind}"><parent link="link{index - 1}"/>'
            f'<child link="{child}"/><origin xyz="{numbers[0]}" rpy="{numbers[1]}"/>'
            f"{moves if kind == 'revolute' else ''}</joint>"
        )
    return Robot.from_urdf("".join(lines) + "</robot>")
