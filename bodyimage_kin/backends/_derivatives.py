"""All derivatives of pose and Jacobian, from the Jacobian itself.

In ``local_world_aligned``, with columns J_i = (v_i, w_i) of the joints along the path, root first::

    dR/dq_i         = [w_i]x R                  dp/dq_i = v_i
    H_lin[:, i, k]  = w_min(i,k) x v_max(i,k)   (min and max along the path)
    H_ang[:, i, k]  = w_k x w_i for k before i, else 0

A prismatic joint has w = 0 and needs no case of its own. Every product below is an ordinary torch operation on the
saved outputs of :class:`PoseAndJacobian`, so differentiating it again gives the second, third and further derivatives,
whatever the backend is able to differentiate itself.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

Evaluate = Callable[[Float[Tensor, "batch n"]], tuple[Float[Tensor, "batch 4 4"], Float[Tensor, "batch 6 n"]]]
Gradient = Callable[[Tensor, Tensor, Tensor | None, Tensor | None, Tensor], Float[Tensor, "batch n"]]
"""The formula of :meth:`PoseAndJacobian.backward`, compiled: of pose, Jacobian, what comes in for each, and path."""


def at_point(
    pose: Float[Tensor, "*batch 4 4"], jacobian: Float[Tensor, "*batch 6 n"], offset: Float[Tensor, "*points 3"]
) -> tuple[Float[Tensor, "*batch 4 4"], Float[Tensor, "*batch 6 n"]]:
    """Pose and Jacobian of a point fixed in the link, the Jacobian in ``local_world_aligned``.

    Args:
        pose: root_T_link.
        jacobian: Of the link's origin.
        offset: The point in the link [m]; one, or one for each of the batch.
    """
    # Sums of products and no matrix products, which autocast would round.
    arm = (pose[..., :3, :3] * offset[..., None, :]).sum(-1, keepdim=True)
    moved = torch.cat([pose[..., :3, :3], pose[..., :3, 3:] + arm], dim=-1)
    linear, angular = jacobian[..., :3, :], jacobian[..., 3:, :]
    linear = linear + torch.linalg.cross(angular, arm.expand(angular.shape), dim=-2)
    return torch.cat([moved, pose[..., 3:, :]], dim=-2), torch.cat([linear, angular], dim=-2)


def hessian(jacobian: Float[Tensor, "*batch 6 n"], path: Tensor) -> Float[Tensor, "*batch 6 n n"]:
    """Derivative of every Jacobian column, ``[..., i, k] = d J[..., i] / d q[k]``.

    Args:
        jacobian: In ``local_world_aligned``, at the link's origin or at any point fixed in it.
        path: Indices (p,) of the joints on the path to the link, root first.
    """
    columns = jacobian[..., path]
    v, w = columns[..., :3, :].unsqueeze(-1), columns[..., 3:, :].unsqueeze(-1)
    count = len(path)
    # cross[a, b] = w_a x v_b, wanted with a = min(i, k) and b = max(i, k).
    upper = torch.ones(count, count, dtype=torch.bool, device=jacobian.device).triu()
    cross = torch.linalg.cross(w, v.transpose(-1, -2), dim=-3)
    linear = torch.where(upper, cross, cross.transpose(-1, -2))
    # [i, k] = w_k x w_i, wanted where k stands strictly before i.
    turn = torch.linalg.cross(w.transpose(-1, -2), w, dim=-3)
    angular = torch.where(upper.T & ~upper, turn, 0.0)
    on_path = torch.cat([linear, angular], dim=-3)
    n = jacobian.shape[-1]
    # Not by matrices of zeros and ones: autocast would round the products.
    rows = on_path.new_zeros(*on_path.shape[:-2], n, count).index_add(-2, path, on_path)
    return rows.new_zeros(*rows.shape[:-1], n).index_add(-1, path, rows)


class PoseAndJacobian(torch.autograd.Function):
    """Pose and Jacobian by any backend, differentiable to any order, under ``vmap``, ``jacrev`` and ``jacfwd``."""

    @staticmethod
    def forward(q: Tensor, path: Tensor, evaluate: Evaluate, gradient: Gradient | None) -> tuple[Tensor, Tensor]:
        """The backend's own values, for q (batch, n)."""
        return evaluate(q)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: tuple[Tensor, Tensor]) -> None:
        """Pose and Jacobian are all that any derivative needs."""
        _, ctx.path, _, ctx.gradient = inputs
        ctx.set_materialize_grads(False)
        ctx.n = inputs[0].shape[-1]
        ctx.save_for_backward(*output)
        ctx.save_for_forward(*output)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor | None) -> tuple[Tensor | None, None, None, None]:
        """Gradient of q, in time linear in the path's length."""
        pose, jacobian = ctx.saved_tensors
        of_pose, of_jacobian = gradients
        if ctx.gradient is not None and _is_last(jacobian):
            return ctx.gradient(pose, jacobian, of_pose, of_jacobian, ctx.path), None, None, None
        columns = jacobian[..., ctx.path]
        v, w = columns[..., :3, :], columns[..., 3:, :]
        on_path = torch.zeros_like(v[..., 0, :])
        if of_pose is not None:
            torque = torch.linalg.cross(pose[..., :3, :3], of_pose[..., :3, :3], dim=-2).sum(-1, keepdim=True)
            on_path = on_path + (v * of_pose[..., :3, 3:]).sum(-2) + (w * torque).sum(-2)
        if of_jacobian is not None:
            chosen = of_jacobian[..., ctx.path]
            g, a = chosen[..., :3, :], chosen[..., 3:, :]
            after = _sum_from(torch.linalg.cross(v, g, dim=-2))
            turned = torch.linalg.cross(w, a, dim=-2)
            after = after + _sum_from(turned) - turned
            moved = torch.linalg.cross(g, w, dim=-2)
            before = moved.cumsum(-1) - moved
            on_path = on_path + (w * after).sum(-2) + (v * before).sum(-2)
        spread = torch.zeros(*on_path.shape[:-1], ctx.n, dtype=on_path.dtype, device=on_path.device)
        return spread.index_copy(-1, ctx.path, on_path), None, None, None

    @staticmethod
    def jvp(ctx: Any, *tangents: Any) -> tuple[Tensor, Tensor]:
        """Forward derivative along dq."""
        pose, jacobian = ctx.saved_tensors
        dq = tangents[0]
        columns, step = jacobian[..., ctx.path], dq[..., None, ctx.path]
        v, w = columns[..., :3, :], columns[..., 3:, :]
        v_step, w_step = v * step, w * step
        turn = w_step.sum(-1, keepdim=True)
        upper = torch.zeros_like(pose[..., :3, :])
        rotation = torch.linalg.cross(turn.expand(pose[..., :3, :3].shape), pose[..., :3, :3], dim=-2)
        upper = torch.cat([rotation, v_step.sum(-1, keepdim=True)], dim=-1)
        d_pose = torch.cat([upper, torch.zeros_like(pose[..., 3:, :])], dim=-2)
        w_until = w_step.cumsum(-1)
        v_after = v_step.sum(-1, keepdim=True) - v_step.cumsum(-1)
        linear = torch.linalg.cross(w_until, v, dim=-2) + torch.linalg.cross(w, v_after, dim=-2)
        angular = torch.linalg.cross(w_until - w_step, w, dim=-2)
        d_jacobian = torch.zeros_like(jacobian).index_copy(-1, ctx.path, torch.cat([linear, angular], dim=-2))
        return d_pose, d_jacobian

    @staticmethod
    def vmap(info: Any, in_dims: Any, q: Tensor, path: Tensor, evaluate: Evaluate, gradient: Gradient | None) -> Any:
        """A mapped axis is one more batch axis."""
        q = q.movedim(in_dims[0], 0)
        pose, jacobian = pose_and_jacobian(q.reshape(-1, q.shape[-1]), path, evaluate, gradient)
        batch = q.shape[:-1]
        return (pose.reshape(*batch, 4, 4), jacobian.reshape(*batch, *jacobian.shape[-2:])), (0, 0)


def pose_and_jacobian(
    q: Float[Tensor, "batch n"], path: Tensor, evaluate: Evaluate, gradient: Gradient | None = None
) -> tuple[Float[Tensor, "batch 4 4"], Float[Tensor, "batch 6 n"]]:
    """The backend's pose and Jacobian, differentiable.

    Args:
        q: Postures.
        path: Indices of the joints on the path to the link, root first.
        evaluate: The backend.
        gradient: Its own formula for backward, used when nobody differentiates that again.
    """
    pose, jacobian = PoseAndJacobian.apply(q, path, evaluate, gradient)  # type: ignore[no-untyped-call]
    return pose, jacobian


def _is_last(jacobian: Tensor) -> bool:
    """Whether a gradient is wanted as mere numbers, and by the formula that compiled code knows."""
    return (
        jacobian.dtype == torch.float64
        and jacobian.is_cpu
        and not torch.is_grad_enabled()
        and torch.autograd.forward_ad._current_level < 0
        and torch._C._functorch.peek_interpreter_stack() is None
    )


def _sum_from(terms: Float[Tensor, "*batch 3 p"]) -> Float[Tensor, "*batch 3 p"]:
    """[..., k] = sum of the terms from k to the end of the path."""
    return terms.flip(-1).cumsum(-1).flip(-1)
