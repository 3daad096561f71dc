"""Bodies drawn from a prior: what a body may be that is thought to be this one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bodyimage_kin import _checks
from bodyimage_kin.body import Embodiment
from bodyimage_kin.calibration.prior import Prior
from bodyimage_kin.estimators.parametric import GROUPS, Group, Mount, ParametricBody

__all__ = ["drawn_bodies"]


def drawn_bodies(
    body: Embodiment,
    count: int,
    *,
    prior: Prior | None = None,
    free: Sequence[Group] = ("axes", "offsets"),
    seed: int = 0,
) -> list[Embodiment]:
    """Bodies whose joints are off by as much as a prior says, each independently.

    Args:
        body: As it is thought to be.
        count: How many.
        prior: How far each measure may be off; None: :class:`Prior`'s defaults.
        free: Kinds of measures that are off: some of ``"axes"``, ``"offsets"`` and ``"encoders"``.
        seed: Same seed, same bodies; the first ones are the same however many there are.

    Returns:
        Bodies with the same camera, hand and skin on links that are elsewhere. Nothing says that such a body still
        reaches all of its skin.

    Raises:
        InvalidConfig: No number of bodies, or another kind of measure.
    """
    for group in free:
        _checks.choice("free", group, GROUPS[:3])
    known = prior or Prior()
    links = {"hand": body.hand.link, "camera": body.camera.link}
    if body.skin is not None:
        links["skin"] = body.skin.link
    mounts = [Mount(name, name, link, np.eye(4)) for name, link in links.items()]  # type: ignore[arg-type]
    parametric = ParametricBody(body.felt_robot, body.joints, mounts)
    sd = np.array([known.sd(one) if one.group in free else 0.0 for one in parametric.parameters])
    found = []
    for number, stream in enumerate(np.random.SeedSequence(seed).spawn(_checks.whole("count", count, least=1))):
        theta = sd * np.random.default_rng(stream).standard_normal(len(sd))
        found.append(
            Embodiment.build(
                body.robot.with_origins(parametric.corrected(theta)),
                joints=body.joints,
                hand=body.hand,
                camera=body.camera,
                skin=body.skin,
                home=body.home,
                name=f"{body.name}_{number}",
                backend=body.kinematics.name,
            )
        )
    return found
