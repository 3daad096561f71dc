"""Joints that follow others, set free and folded again: no matrix products, which autocast would round."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float, Float64, Int64
from torch import Tensor

from bodyimage_kin.robot import Robot


class Folding(NamedTuple):
    """What drives each joint of ``robot.unfolded``.

    Attributes:
        n: Number of the robot's own joint values.
        columns: Where the value that drives it stands in q.
        multipliers: By what that is multiplied.
        offsets: What is added [rad or m].
    """

    n: int
    columns: Int64[Tensor, "unfolded"]
    multipliers: Float64[Tensor, "unfolded"]
    offsets: Float64[Tensor, "unfolded"]

    @classmethod
    def of(cls, robot: Robot) -> Folding:
        """That of a robot."""
        sources = [robot.source_of(name) for name in robot.unfolded.joint_names]
        columns = torch.tensor([robot.joint_index(name) for name, _, _ in sources], dtype=torch.long)
        values = torch.tensor([(multiplier, offset) for _, multiplier, offset in sources], dtype=torch.float64)
        multipliers, offsets = values.reshape(-1, 2).unbind(1)
        return cls(robot.n, columns, multipliers, offsets)

    def unfold(self, q: Float[Tensor, "*batch n"]) -> Float[Tensor, "*batch unfolded"]:
        """The posture of the robot whose followers are free."""
        return q[..., self.columns.to(q.device)] * self.multipliers.to(q) + self.offsets.to(q)

    def fold(self, jacobian: Float[Tensor, "*rows unfolded"]) -> Float[Tensor, "*rows n"]:
        """Derivatives by the robot's own joints from those by the free ones, along the last axis."""
        zeros = jacobian.new_zeros(*jacobian.shape[:-1], self.n)
        return zeros.index_add(-1, self.columns.to(jacobian.device), jacobian * self.multipliers.to(jacobian))
