"""A robot: one URDF, read once and checked.

A robot knows names, order, limits, structure and the geometry of its links. It computes no kinematics itself: backends
do, from the kinematic core that :meth:`Robot.to_urdf` writes. Everything here is immutable.
"""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import torch
from jaxtyping import Float64

from bodyimage_kin import _checks
from bodyimage_kin._arrays import ArrayLike, as_float_array, as_postures, refuse_not_finite
from bodyimage_kin.errors import InvalidConfig, InvalidPosture, UnknownName
from bodyimage_kin.robot import _page, _source, dh, transforms
from bodyimage_kin.robot.geometry import LinkGeometry
from bodyimage_kin.robot.reader import read_urdf
from bodyimage_kin.robot.tree import Joint, KinematicTree, Mimic, welded, write_core

__all__ = ["Posture", "Robot", "Source"]

Posture: TypeAlias = "ArrayLike | Mapping[str, float]"
Source: TypeAlias = Any
"""A path, an open file, or text: str, bytes, bytearray or memoryview; checked at run time by our own errors."""


_MOST_VALUES = 10**9


@dataclass(frozen=True)
class Robot:
    """One checked robot. Build it with :meth:`from_urdf` or :meth:`from_dh`.

    Two robots are equal when they were read from the same text, wherever that lay.

    Attributes:
        tree: Links and joints as they stand in the file.
        source: The bytes it was read from.
        geometry: What each link has beside its frame: visuals, collisions, inertial.
        notes: What the reader read leniently, left out or passed over, a line each.
        file: Where it was read from, None when it was given as text.
        mesh_folder: Where its meshes may lie, subfolders included; None: beside the file.
    """

    tree: KinematicTree
    source: bytes
    geometry: Mapping[str, LinkGeometry] = field(default_factory=dict)
    notes: tuple[str, ...] = field(default=(), compare=False)
    file: Path | None = field(default=None, compare=False)
    mesh_folder: Path | None = field(default=None, compare=False)

    @classmethod
    def from_urdf(
        cls, source: Source, strict: bool = False, *, mesh_folder: str | os.PathLike[str] | None = None
    ) -> Robot:
        """Reads and checks a URDF.

        What is written carelessly but can be meant in one way only (an undeclared ``world``, a floating joint under the
        root, a missing ``<limit>``, without which a joint is unlimited) is read that way and noted.

        Args:
            source: A path, an open file, or the text itself (str, bytes or bytearray that begin with ``<``).
            strict: Refuse what is written carelessly.
            mesh_folder: Where its meshes may lie, subfolders included; None: beside the file. None is read before it is
                drawn, or a skin is laid on it.

        Raises:
            InvalidURDF: The file is missing or is not a URDF that can be trusted; names element, line and remedy.
        """
        data, file = _source.read(source)
        reading = read_urdf(data, name=file.stem if file else "robot", strict=_checks.flag("strict", strict))
        folder = None if mesh_folder is None else Path(mesh_folder)
        return cls(reading.tree, data, reading.geometry, reading.notes, file, folder)

    @classmethod
    def from_dh(
        cls,
        rows: ArrayLike,
        convention: Literal["classic", "modified"] | str = "classic",
        *,
        kinds: Sequence[str] | None = None,
        joints: Sequence[str] | None = None,
        links: Sequence[str] | None = None,
        limits: Sequence[ArrayLike | None] | None = None,
        name: str = "robot",
    ) -> Robot:
        """A serial robot from Denavit and Hartenberg's parameters.

        With theta = offset + q of a turning joint and d + q of a sliding one, each row is the transform::

            classic:   Rz(theta) Tz(d) Tx(a) Rx(alpha)      (Denavit and Hartenberg 1955; Spong)
            modified:  Rx(alpha) Tx(a) Rz(theta) Tz(d)      (Craig; a and alpha are those of the row before)

        Args:
            rows: (k, 4): a [m], d [m], alpha [rad], offset [rad] of each row.
            convention: Which of both.
            kinds: Of each row: ``"revolute"``, ``"continuous"``, ``"prismatic"`` or ``"fixed"``; None: all revolute.
            joints: Name of each row's joint; None: ``joint1`` to ``jointk``.
            links: Names of the k + 1 frames, the root first; None: ``link0`` to ``linkk``.
            limits: Lower and upper limit of each row's joint [rad or m], None for no limit; None: no limits at all.
            name: The robot's name.

        Returns:
            A robot whose links are the frames of the table. A classic joint turns about an axis that need not pass
            through its frame, so each has one more link, ``NAME_turned`` after its joint, that the frame is fixed to.

        Raises:
            InvalidConfig: Rows, kinds, names or limits that do not fit together.
        """
        tree = dh.read_table(rows, convention, kinds=kinds, joints=joints, links=links, limits=limits, name=name)
        return cls._from_tree(tree, {})

    @classmethod
    def _from_tree(cls, tree: KinematicTree, geometry: Mapping[str, LinkGeometry]) -> Robot:
        every = {link: geometry.get(link, LinkGeometry()) for link in tree.links}
        return cls(tree, write_core(tree).encode(), every)

    def __hash__(self) -> int:
        # Not that of the bytes: it would be another one in another process.
        return int(self.sha256[:15], 16)

    def __repr__(self) -> str:
        return f"Robot({self.name!r}, {len(self.link_names)} links, {self.n} joints)"

    def _repr_html_(self) -> str:
        """The same for notebooks: a line, and a table of the joints that a posture has values for."""
        return _page.of(self.tree, self.moving_joints, self.sha256, self.notes)

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
        """Lower limits [rad or m], -inf where there is none."""
        return torch.tensor([joint.lower for joint in self.moving_joints], dtype=torch.float64)

    @cached_property
    def upper(self) -> Float64[torch.Tensor, "n"]:
        """Upper limits [rad or m], inf where there is none."""
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

        Where only one limit is given, within 2 pi of it. Limits of followers are not looked at: they bind no free
        joint.

        Args:
            batch: Shape of the batch; an int is a batch of one axis.
            seed: Same seed, same bits.

        Raises:
            InvalidConfig: A shape or a seed that is no whole number, or negative, or more than a billion joint values.
        """
        sizes = (batch,) if not isinstance(batch, Iterable) else tuple(batch)
        shape = [_checks.whole("batch", size, least=0) for size in sizes]
        if math.prod((*shape, self.n)) > _MOST_VALUES:
            raise InvalidConfig(
                f"batch {tuple(shape)} is too large; draw at most {_MOST_VALUES:.0e} joint values at once"
            )
        rng = np.random.default_rng(_checks.whole("seed", seed, least=0))
        unit = torch.from_numpy(rng.random((*shape, self.n)))
        lower, upper = self._bounds
        # The range of the largest limits is no number, though each of them is one.
        return torch.where((upper - lower).isinf(), lower * (1.0 - unit) + upper * unit, lower + unit * (upper - lower))

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
            if not math.isfinite(q[index]):
                raise InvalidPosture(f"joint '{name}' is at {values[name]}; NaN or infinite values are no posture")
        refuse_not_finite(q[None], "base posture")
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

    def with_origins(self, origins: Mapping[str, ArrayLike]) -> Robot:
        """The robot with other joint origins: full 6D poses, which every reader of URDF understands.

        Args:
            origins: Joint -> (4, 4) where the child's frame is in the parent's at value zero [m].

        Raises:
            UnknownName: A joint that does not exist.
            InvalidArray: No 4x4 transforms.
        """
        joints = {joint.name: joint for joint in self.tree.joints}
        for name, origin in origins.items():
            if name not in joints:
                raise UnknownName("joint", name, joints)
            pose = as_float_array(origin, f"origin of joint '{name}'", shapes=((4, 4),))
            x, y, z = pose[:3, 3].tolist()
            joints[name] = replace(joints[name], xyz=(x, y, z), rpy=transforms.matrix_rpy(pose[:3, :3]))
        return self._with_joints(list(joints.values()))

    def reordered(self, joints: Sequence[str]) -> Robot:
        """The same robot with another order of q; itself when that is its order already.

        Args:
            joints: All of :attr:`joint_names`, in the order wanted.

        Raises:
            UnknownName: A joint that does not exist.
            InvalidConfig: A joint that is missing, or stands twice.
        """
        wanted = [self._joints_by_name[self.joint_names[self.joint_index(name)]] for name in joints]
        if len(wanted) != self.n or len({joint.name for joint in wanted}) != self.n:
            raise InvalidConfig(f"joints={list(joints)!r}: give each of {', '.join(self.joint_names)} once")
        if wanted == list(self.moving_joints):
            return self
        in_turn = iter(wanted)
        return self._with_joints([next(in_turn) if joint in wanted else joint for joint in self.tree.joints])

    @cached_property
    def _bounds(self) -> tuple[Float64[torch.Tensor, "n"], Float64[torch.Tensor, "n"]]:
        """Finite bounds to sample within."""
        turn = 2.0 * math.pi
        no_lower, no_upper = self.lower.isinf(), self.upper.isinf()
        lower = torch.where(no_lower, torch.where(no_upper, -math.pi, self.upper - turn), self.lower)
        upper = torch.where(no_upper, torch.where(no_lower, math.pi, self.lower + turn), self.upper)
        return lower, upper

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
        return welded(joint, multiplier * values[source] + offset)

    def _with_joints(self, joints: Sequence[Joint]) -> Robot:
        links = {self.root} | {joint.child for joint in joints}
        tree = KinematicTree(
            self.name, self.root, tuple(link for link in self.tree.links if link in links), tuple(joints)
        )
        return Robot._from_tree(tree, self.geometry)
