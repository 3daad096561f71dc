"""A robot: one URDF, read once and checked.

A robot knows names, order, limits and structure. It computes no kinematics itself: backends do, from the kinematic core
that :meth:`Robot.to_urdf` writes. Everything here is immutable.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TypeAlias

import numpy as np
import torch
from jaxtyping import Float64

from bodyimage_kin._arrays import ArrayLike, as_postures, refuse_not_finite
from bodyimage_kin.errors import InvalidPosture, InvalidURDF, UnknownName
from bodyimage_kin.robot import transforms
from bodyimage_kin.robot.reader import read_urdf
from bodyimage_kin.robot.tree import Joint, KinematicTree, Mimic, write_core

Posture: TypeAlias = "ArrayLike | Mapping[str, float]"


@dataclass(frozen=True, eq=False)
class Robot:
    """One checked URDF. Build it with :meth:`from_urdf`.

    Attributes:
        tree: Links and joints as they stand in the file.
        source: The bytes it was read from.
        file: Where it was read from, None when it was given as text. Geometry is looked for beside it.
    """

    tree: KinematicTree
    source: bytes
    file: Path | None = None

    @classmethod
    def from_urdf(cls, source: str | bytes | Path) -> Robot:
        """Reads and checks a URDF.

        Args:
            source: A path, or the text itself (str or bytes that begin with ``<``).

        Raises:
            InvalidURDF: The file is missing or is not a URDF that can be trusted; names element, line and remedy.
        """
        if isinstance(source, bytes | str) and source.lstrip()[:1] in ("<", b"<", "\ufeff"):
            data = source.encode() if isinstance(source, str) else source
            return cls(read_urdf(data), data)
        path = Path(source.decode() if isinstance(source, bytes) else source)
        try:
            data = path.read_bytes()
        except (OSError, ValueError) as problem:
            reason = problem.strerror if isinstance(problem, OSError) else str(problem)
            raise InvalidURDF(
                f"cannot read '{path}': {reason}", remedy="give a path, or text beginning with '<'"
            ) from None
        return cls(read_urdf(data), data, path)

    def __repr__(self) -> str:
        return f"Robot({self.name!r}, {len(self.link_names)} links, {self.n} joints)"

    # Names and order -------------------------------------------------------------------------------------------------

    @property
    def name(self) -> str:
        """The robot's name."""
        return self.tree.name

    @property
    def root(self) -> str:
        """The link everything else hangs from."""
        return self.tree.root

    @property
    def link_names(self) -> tuple[str, ...]:
        """Every link, in order of appearance in the file."""
        return self.tree.links

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """The moving joints that follow no other, in order of appearance in the file: the canonical order of q."""
        return tuple(joint.name for joint in self.moving_joints)

    @cached_property
    def moving_joints(self) -> tuple[Joint, ...]:
        """The joints that :attr:`joint_names` names."""
        return tuple(joint for joint in self.tree.joints if joint.kind != "fixed" and joint.mimic is None)

    @property
    def n(self) -> int:
        """Number of joint values in a posture."""
        return len(self.joint_names)

    @cached_property
    def lower(self) -> Float64[torch.Tensor, "n"]:
        """Lower limits [rad or m], -inf for continuous joints."""
        return torch.tensor([joint.lower for joint in self.moving_joints], dtype=torch.float64)

    @cached_property
    def upper(self) -> Float64[torch.Tensor, "n"]:
        """Upper limits [rad or m], inf for continuous joints."""
        return torch.tensor([joint.upper for joint in self.moving_joints], dtype=torch.float64)

    @cached_property
    def sha256(self) -> str:
        """Hash of the source, hexadecimal."""
        return hashlib.sha256(self.source).hexdigest()

    def to_urdf(self) -> str:
        """The checked kinematic core, links and joints only, as XML: all that a backend gets to see."""
        return write_core(self.tree)

    def joint_index(self, name: str) -> int:
        """Where a joint stands in q.

        Raises:
            UnknownName: No moving joint bears this name.
        """
        try:
            return self._joint_indices[name]
        except (KeyError, TypeError):
            raise UnknownName("joint", name, self.joint_names) from None

    def check_link(self, name: str) -> str:
        """The name itself.

        Raises:
            UnknownName: No link bears this name.
        """
        if not isinstance(name, str) or name not in self._joint_above:
            raise UnknownName("link", name, self.link_names)
        return name

    # Postures --------------------------------------------------------------------------------------------------------

    def sample(self, batch: int | Sequence[int], seed: int = 0) -> Float64[torch.Tensor, "*batch n"]:
        """Postures drawn uniformly within the limits, in [-pi, pi] (rad or m) where there are none.

        Args:
            batch: Shape of the batch; an int is a batch of one axis.
            seed: Same seed, same bits.
        """
        shape = (batch,) if isinstance(batch, int) else tuple(batch)
        unit = torch.from_numpy(np.random.default_rng(seed).random((*shape, self.n)))
        lower = torch.where(self.lower.isinf(), -math.pi, self.lower)
        upper = torch.where(self.upper.isinf(), math.pi, self.upper)
        return lower + unit * (upper - lower)

    def posture(self, values: Mapping[str, float], base: ArrayLike | None = None) -> Float64[torch.Tensor, "n"]:
        """A posture by name.

        Args:
            values: Joint values [rad or m] by joint name.
            base: Posture (n,) of the joints not named; None: every joint must be named.

        Raises:
            UnknownName: A joint that does not exist.
            InvalidPosture: A joint that is missing, or a value that is no finite number.
        """
        indices = {self.joint_index(name): name for name in values}
        if base is None:
            missing = [name for name in self.joint_names if name not in values]
            if missing:
                raise InvalidPosture(f"no value for {', '.join(missing)}; name every joint or give a base posture")
            q = torch.zeros(self.n, dtype=torch.float64)
        else:
            q = as_postures(base, self.n, "base posture").detach().to(torch.float64).clone()
            if q.ndim != 1:
                raise InvalidPosture(f"base posture has shape {tuple(q.shape)}; it must be one posture, ({self.n},)")
        for index, name in indices.items():
            try:
                q[index] = float(values[name])
            except (TypeError, ValueError):
                raise InvalidPosture(f"the value of joint '{name}' is no number: {values[name]!r}") from None
        refuse_not_finite(q[None])
        return q

    def named(self, q: ArrayLike) -> dict[str, float]:
        """One posture (n,) as a mapping from joint name to value [rad or m].

        Raises:
            InvalidPosture: Not one posture of this robot.
        """
        tensor = as_postures(q, self.n)
        if tensor.ndim != 1:
            raise InvalidPosture(f"posture q has shape {tuple(tensor.shape)}; named() reads one posture, ({self.n},)")
        return dict(zip(self.joint_names, tensor.detach().tolist(), strict=True))

    # Structure -------------------------------------------------------------------------------------------------------

    def path(self, link: str) -> tuple[Joint, ...]:
        """Every joint from the root to the link, fixed and following ones included, root first.

        Raises:
            UnknownName: No such link.
        """
        joints = []
        here = self.check_link(link)
        while (joint := self._joint_above[here]) is not None:
            joints.append(joint)
            here = joint.parent
        return tuple(reversed(joints))

    @cached_property
    def unfolded(self) -> Robot:
        """The robot with every following joint set free; itself when there is none."""
        if all(joint.mimic is None for joint in self.tree.joints):
            return self
        return self._with_joints([replace(joint, mimic=None) for joint in self.tree.joints])

    @cached_property
    def folding(self) -> tuple[Float64[torch.Tensor, "unfolded n"], Float64[torch.Tensor, "unfolded"]]:
        """Matrix and offset that give the unfolded robot's posture: ``q_unfolded = matrix @ q + offset``."""
        matrix = torch.zeros(self.unfolded.n, self.n, dtype=torch.float64)
        offset = torch.zeros(self.unfolded.n, dtype=torch.float64)
        for row, name in enumerate(self.unfolded.joint_names):
            source, multiplier, constant = self.source_of(name)
            matrix[row, self.joint_index(source)] = multiplier
            offset[row] = constant
        return matrix, offset

    def source_of(self, joint: str) -> tuple[str, float, float]:
        """What drives a joint: (name, multiplier, offset), chains of followers resolved; itself, 1, 0 when free."""
        multiplier, offset = 1.0, 0.0
        while (mimic := self._joints_by_name[joint].mimic) is not None:
            offset += multiplier * mimic.offset
            multiplier *= mimic.multiplier
            joint = mimic.joint
        return joint, multiplier, offset

    def subtree(
        self, links: Iterable[str], joints: Iterable[str] | None = None, posture: Posture | None = None
    ) -> Robot:
        """The smaller robot that moves these links; every other joint is welded, and what then hangs loose is left out.

        Args:
            links: Links to keep, with all that leads to them from the root.
            joints: The joints that go on moving, all of them kept; None: all that move one of the links.
            posture: Where the others are welded, (n,) or a mapping (joints not named: zero); None: all at zero.

        Raises:
            UnknownName: A link or joint that does not exist.
            InvalidPosture: A posture of another size.
        """
        wanted = [joint for link in links for joint in self.path(link)]
        if joints is None:
            moving = {self.source_of(joint.name)[0] for joint in wanted if joint.kind != "fixed"}
        else:
            moving = {self.joint_names[self.joint_index(name)] for name in joints}
        for name in sorted(moving):
            wanted.extend(self.path(self._joints_by_name[name].child))
        q = self._values(posture)
        kept = {joint.name for joint in wanted}
        return self._with_joints(
            [self._welded(joint, q, moving) for joint in self.tree.joints if joint.name in kept],
        )

    @cached_property
    def _joint_indices(self) -> dict[str, int]:
        return {name: index for index, name in enumerate(self.joint_names)}

    @cached_property
    def _joints_by_name(self) -> dict[str, Joint]:
        return {joint.name: joint for joint in self.tree.joints}

    @cached_property
    def _joint_above(self) -> dict[str, Joint | None]:
        return {self.root: None, **{joint.child: joint for joint in self.tree.joints}}

    def _values(self, posture: Posture | None) -> dict[str, float]:
        if posture is None:
            return dict.fromkeys(self.joint_names, 0.0)
        if isinstance(posture, Mapping):
            return self.named(self.posture(posture, base=torch.zeros(self.n, dtype=torch.float64)))
        return self.named(posture)

    def _welded(self, joint: Joint, values: Mapping[str, float], moving: set[str]) -> Joint:
        """The joint itself when it goes on moving, else the fixed joint it is at these values."""
        if joint.kind == "fixed":
            return joint
        source, multiplier, offset = self.source_of(joint.name)
        if source in moving:
            # A chain of followers is tied to its source directly: what stands between may be left out.
            return joint if joint.mimic is None else replace(joint, mimic=Mimic(source, multiplier, offset))
        value = multiplier * values[source] + offset
        fixed = replace(joint, kind="fixed", mimic=None, lower=0.0, upper=0.0)
        if value == 0.0:
            return fixed
        rotation = transforms.rpy_matrix(joint.rpy)
        if joint.kind == "prismatic":
            x, y, z = np.asarray(joint.xyz) + rotation @ np.asarray(joint.axis) * value
            return replace(fixed, xyz=(float(x), float(y), float(z)))
        turned = rotation @ transforms.axis_angle_matrix(joint.axis, value)
        return replace(fixed, rpy=transforms.matrix_rpy(turned))

    def _with_joints(self, joints: Sequence[Joint]) -> Robot:
        links = {self.root} | {joint.child for joint in joints}
        tree = KinematicTree(
            self.name, self.root, tuple(link for link in self.tree.links if link in links), tuple(joints)
        )
        return Robot(tree, write_core(tree).encode())
