"""An embodiment as triangles, and the way its face looks."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from bodyimage_kin._arrays import ArrayLike
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.figures.visuals import Surface, triangles


def felt_links(body: Embodiment) -> tuple[str, ...]:
    """The links that felt joints move, and the one that bears the skin."""
    moved = [
        link
        for link in body.robot.link_names
        if link == body.require_skin().link or any(joint.name in body.joints for joint in body.robot.path(link))
    ]
    return tuple(moved)


def posed(body: Embodiment, q: ArrayLike | None, links: Iterable[str]) -> Surface:
    """Some links at a felt posture (p,), the other joints at home; with no posture, all of the robot at zero."""
    posture = {} if q is None else body.robot.named(body.full_posture(q))
    return triangles(body.robot, posture, links=links)


def facing(body: Embodiment) -> float:
    """The azimuth that the face looks to, the robot at home [degrees]."""
    forward = body.require_skin().root_T_link[:3, :3].numpy() @ body.require_skin().patch.forward
    return float(np.degrees(np.arctan2(forward[1], forward[0])))
