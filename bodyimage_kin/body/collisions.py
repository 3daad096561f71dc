"""Which links of a robot run into which, by the convex hulls of what they are made of."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin.backends import RobotKinematics, kinematics
from bodyimage_kin.errors import InvalidGeometry
from bodyimage_kin.robot import Robot
from bodyimage_kin.robot.shapes import corners, link_parts
from bodyimage_kin.robot.transforms import Matrix4
from bodyimage_kin.robot.tree import Joint

__all__ = ["Hulls", "vertices_of"]

_DRAWN, _ALWAYS = 200, 0.95
_OUTERMOST = 200
_DIRECTIONS = np.random.default_rng(0).normal(size=(_OUTERMOST, 3))


def vertices_of(
    robot: Robot, link: str, mesh_folder: Path | None = None, problems: list[str] | None = None
) -> list[Float[np.ndarray, "vertices 3"]]:
    """The corners of each shape that stands for a link (:func:`bodyimage_kin.robot.shapes.link_parts`), in it [m].

    Args:
        robot: The robot.
        link: Its link.
        mesh_folder: Where meshes may lie, subfolders included; None: where the robot says.
        problems: Why shapes were left out is added to it.

    Returns:
        One array a shape; shapes that cannot be read, and meshes that are not there, are left out.
    """
    found = []
    for element in link_parts(robot, link, mesh_folder).elements:
        try:
            found.append(corners(element, robot, link, mesh_folder))
        except InvalidGeometry as problem:
            if problems is not None:
                problems.append(str(problem))
    return found


@dataclass(frozen=True, eq=False)
class Hulls:
    """A robot's links as convex hulls, one a shape, by the library coal.

    Pairs that no posture can part say nothing and are never reported: links that a joint joins, links welded together,
    and those that overlap in nearly all postures drawn at random.

    Attributes:
        robot: The robot.
        joints: Only pairs that these joints move against each other count.
        mesh_folder: Where meshes may lie, subfolders included; None: where the robot says.
    """

    robot: Robot
    joints: Sequence[str]
    mesh_folder: Path | None = None

    def collisions(self, q: Float[Tensor, "n"]) -> tuple[tuple[str, str], ...]:
        """Pairs of links that overlap at a posture of the whole robot.

        Args:
            q: (n,) [rad or m].
        """
        poses = self._poses(q[None])
        return tuple(pair for pair in self._pairs if self._overlap(pair, poses, 0))

    def beyond(self, link: str) -> set[str]:
        """The links that move with a link whatever the robot does, and all that hang on these."""
        first = self._bodies[self.robot.check_link(link)][0]
        return {
            one
            for one in self.robot.link_names
            if first == self.robot.root or first in {joint.child for joint in self.robot.path(one)}
        }

    @cached_property
    def shapes(self) -> Mapping[str, tuple[Any, ...]]:
        """Hulls by link, of the links that have any."""
        hulls = {
            link: tuple(_hull(part) for part in vertices_of(self.robot, link, self.mesh_folder))
            for link in self.robot.link_names
        }
        return {link: parts for link, parts in hulls.items() if parts}

    def _poses(self, q: Float[Tensor, "batch n"]) -> dict[str, Float[np.ndarray, "batch 4 4"]]:
        return {link: self._kinematics.pose(q, link).numpy() for link in self.shapes}

    @cached_property
    def _kinematics(self) -> RobotKinematics:
        return kinematics(self.robot)

    @cached_property
    def _pairs(self) -> list[tuple[str, str]]:
        """Pairs that the joints move against each other, and that some postures part."""
        body = self._bodies
        moved = {
            link: {name for joint in self.robot.path(link) if (name := self._source(joint)) in self.joints}
            for link in self.shapes
        }
        pairs = [
            (one, other)
            for one, other in itertools.combinations(self.shapes, 2)
            if moved[one] != moved[other] and body[one][0] not in body[other] and body[other][0] != body[one][1]
        ]
        poses = self._poses(self.robot.sample(_DRAWN, seed=0))
        return [
            pair for pair in pairs if np.mean([self._overlap(pair, poses, index) for index in range(_DRAWN)]) < _ALWAYS
        ]

    def _source(self, joint: Joint) -> str:
        return "" if joint.kind == "fixed" else self.robot.source_of(joint.name)[0]

    @cached_property
    def _bodies(self) -> dict[str, tuple[str, str]]:
        """For each link the first link of the rigid body it belongs to, and that of the body it hangs on."""
        found = {}
        for link in self.robot.link_names:
            firsts = [self.robot.root, *(joint.child for joint in self.robot.path(link) if joint.kind != "fixed")]
            found[link] = (firsts[-1], firsts[-2] if len(firsts) > 1 else "")
        return found

    def _overlap(self, pair: tuple[str, str], poses: Mapping[str, Float[np.ndarray, "batch 4 4"]], index: int) -> bool:
        one, other = (poses[link][index] for link in pair)
        return any(
            _touch(first, one, second, other) for first in self.shapes[pair[0]] for second in self.shapes[pair[1]]
        )


def _hull(corners: Float[np.ndarray, "vertices 3"]) -> Any:
    """The convex hull; of a round mesh that of its outermost points, for coal takes no vertex with many neighbours."""
    import coal

    if len(corners) > _OUTERMOST:
        corners = corners[np.unique((_DIRECTIONS @ corners.T).argmax(1))]
    model = coal.BVHModelOBBRSS()
    model.beginModel(0, len(corners))
    model.addVertices(corners)
    model.endModel()
    model.buildConvexHull(True, "Qt")
    return model.convex


def _touch(one: Any, root_T_one: Matrix4, other: Any, root_T_other: Matrix4) -> bool:
    import coal

    places = [coal.Transform3s(pose[:3, :3], pose[:3, 3]) for pose in (root_T_one, root_T_other)]
    result = coal.CollisionResult()
    return bool(coal.collide(one, places[0], other, places[1], coal.CollisionRequest(), result))
