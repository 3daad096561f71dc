"""What every backend shares: checks, batch shapes, dtypes, frames of reference, followers, hessians and gradients."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property, partial
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import torch
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin._arrays import ArrayLike, as_float_tensor, as_postures, refuse_not_finite
from bodyimage_kin.backends import _derivatives, _stream
from bodyimage_kin.backends._folding import Folding
from bodyimage_kin.backends._protocol import Kinematics, abilities, moving_columns
from bodyimage_kin.errors import InvalidArray, NotDifferentiable, UnsupportedDevice
from bodyimage_kin.robot import Robot

Reference = Literal["local_world_aligned", "local", "world"]
Out: TypeAlias = Any
"""A pair of tensors (pose, jacobian) to write into; checked at run time by our own typed errors."""


_NO_GRADIENT = "what is written into out= carries no gradient; leave it out, or give {}.detach()"


class _Path(NamedTuple):
    """What the shared code has to know about the way to a link."""

    link: str
    as_it_is: bool
    """Whether the backend takes the robot's own postures; if not, the unfolded robot's."""
    columns: Tensor
    """Indices of the path's joints, root first, in the postures by which derivatives are taken: the robot's own if
    nothing needs unfolding for them, else the unfolded robot's."""
    unfolded: Kinematics | None
    """What computes for the unfolded robot when derivatives need that, else None."""


class RobotKinematics:
    """Forward kinematics, Jacobians and their derivatives of one robot, computed by one backend.

    Every method takes postures ``q`` of any batch shape, ``(*batch, n)``, as tensor, array or list (lists become
    float64), and gives tensors of the dtype and on the device of ``q``, differentiable to any order. On the CPU float32
    postures are computed in float64 and rounded once, at the end; other devices compute in the dtype of ``q``.

    Attributes:
        robot: Whose kinematics these are.
        backend: The object that computes pose and Jacobian, built for ``robot.unfolded``, or for the robot itself if it
            resolves followers (:class:`Abilities`).
        name: The backend's name.
    """

    def __init__(self, robot: Robot, backend: Kinematics, name: str) -> None:
        self.robot, self.backend, self.name = robot, backend, name
        self._n = robot.n
        self._able = abilities(backend)
        self._paths: dict[str, _Path] = {}
        self._unfolded_backend: Kinematics | None = None

    def __repr__(self) -> str:
        return f"RobotKinematics({self.robot.name!r}, backend={self.name!r})"

    def pose(self, q: ArrayLike, link: str, offset: ArrayLike | None = None) -> Float[Tensor, "*batch 4 4"]:
        """root_T_link: maps the link's coordinates [m] to the root's.

        Args:
            q: Postures ``(*batch, n)`` [rad or m].
            link: Name of the link.
            offset: A point fixed in the link, (3,) or one a posture ``(*batch, 3)`` [m], at which the frame is moved
                without being turned; None: the link's origin. Results are differentiable in it.

        Raises:
            InvalidArray: An offset of another shape, or that is not finite.
            InvalidPosture: Wrong last axis, dtype, or a value that is not finite.
            UnknownName: No such link.
            UnsupportedDevice: A tensor that is not on the CPU, and a backend that computes nowhere else.
        """
        return self.pose_and_jacobian(q, link, offset=offset)[0]

    def jacobian(
        self,
        q: ArrayLike,
        link: str,
        reference: Reference | str = "local_world_aligned",
        offset: ArrayLike | None = None,
    ) -> Float[Tensor, "*batch 6 n"]:
        """The Jacobian of a link, rows linear [m/rad] then angular [rad/rad] ([m/m] and 0 for prismatic joints).

        Args:
            q: Postures ``(*batch, n)`` [rad or m].
            link: Name of the link.
            reference: ``"local_world_aligned"``: axes of the root, origin at the link. ``"local"``: axes of the link,
                origin at the link. ``"world"``: the spatial Jacobian, axes and origin of the root (Pinocchio's names;
                Murray, Li and Sastry 1994, section 3.4, for the spatial and body ones).
            offset: A point fixed in the link that takes the place of its origin, as in :meth:`pose`. The spatial
                Jacobian is the same for every one.

        Raises:
            InvalidConfig: Another reference.
            InvalidPosture: As in :meth:`pose`, and so for the other errors.
        """
        _checks.choice("reference", reference, get_args(Reference))
        pose, jacobian = self.pose_and_jacobian(q, link, offset=offset)
        if reference == "local_world_aligned":
            return jacobian
        linear, angular = jacobian[..., :3, :], jacobian[..., 3:, :]
        if reference == "local":
            root_R_link = pose[..., :3, :3, None]
            # Sums of products and no matrix products, which autocast would round.
            turned = [(root_R_link * rows[..., None, :]).sum(-3) for rows in (linear, angular)]
            return torch.cat(turned, dim=-2)
        position = pose[..., :3, 3:].expand_as(angular)
        return torch.cat([linear + torch.linalg.cross(position, angular, dim=-2), angular], dim=-2)

    def pose_and_jacobian(
        self, q: ArrayLike, link: str, out: Out = None, offset: ArrayLike | None = None
    ) -> tuple[Float[Tensor, "*batch 4 4"], Float[Tensor, "*batch 6 n"]]:
        """Both at the cost of one: root_T_link and the Jacobian in ``local_world_aligned``.

        Args:
            q: Postures ``(*batch, n)`` [rad or m].
            link: Name of the link.
            out: Pose and Jacobian to write into and to give back, contiguous, of the shapes of the result and of the
                dtype and on the device of ``q``; None: new tensors. For large batches most of the time goes into fresh
                memory. What they hold after an error is undefined.
            offset: A point fixed in the link that takes the place of its origin, as in :meth:`pose`.

        Raises:
            InvalidArray: An ``out`` that cannot hold the result.
            NotDifferentiable: An ``out``, and postures or an offset that require a gradient.
            InvalidPosture: As in :meth:`pose`, and so for the other errors.
        """
        path = self._paths.get(link) or self._path(link)
        q = self._checked(q)
        if offset is not None:
            return self._at_point(q, link, self._checked_offset(offset, q), out)
        if out is None:
            if somebody_differentiates(q):
                return self._differentiable(q, path)
        else:
            self._check_out(q, out)
        if path.as_it_is:
            return self._evaluate(self.backend, q, link, out)
        pose, jacobian = self._evaluate(self.backend, self._folding.unfold(q), link)
        jacobian = self._folding.fold(jacobian)
        if out is not None:
            pose, jacobian = out[0].copy_(pose), out[1].copy_(jacobian)
        return pose, jacobian

    def stream(
        self, source: Any, link: str, batch: int = 16384
    ) -> Iterator[tuple[Float[Tensor, "batch 4 4"], Float[Tensor, "batch 6 n"]]]:
        """Pose and Jacobian of any number of postures, in constant memory.

        **What is given is used again**: each pair is overwritten by the next one. Reduce it, or copy what is to stay::

            for pose, jacobian in kin.stream(np.load("postures.npy", mmap_mode="r"), "hand"):
                total += jacobian.square().sum()

        Args:
            source: Postures (N, n), as an array, a tensor or a memory map, or an iterable (a generator, say) of such.
            link: Name of the link.
            batch: Most postures at a time. What fits the processor's caches is fastest.

        Returns:
            An iterator over pairs as :meth:`pose_and_jacobian` gives them, in the order of the source; the largest has
            ``batch`` postures.

        Raises:
            NotDifferentiable: Postures that require a gradient (when the iterator comes to them).
            InvalidConfig: A ``batch`` that is no positive number.
            InvalidPosture: As in :meth:`pose`, and so for the other errors (when the iterator comes to them).
        """
        self._paths.get(link) or self._path(link)
        _checks.whole("batch", batch, least=1)
        postures = _stream.chunks(source, self._n, batch)
        return _stream.stream(postures, lambda q, out: self.pose_and_jacobian(q, link, out), self._n, batch)

    def hessian(self, q: ArrayLike, link: str, offset: ArrayLike | None = None) -> Float[Tensor, "*batch 6 n n"]:
        """Derivative of the Jacobian: ``[..., i, k] = d jacobian(q, link)[..., i] / d q[k]``, ``local_world_aligned``.

        Args:
            q: Postures ``(*batch, n)`` [rad or m].
            link: Name of the link.
            offset: A point fixed in the link that takes the place of its origin, as in :meth:`pose`.

        Raises:
            InvalidPosture: As in :meth:`pose`, and so for the other errors.
        """
        path = self._paths.get(link) or self._path(link)
        q = self._checked(q)
        pose, jacobian = self._differentiable(q, path, fold=False)
        if offset is not None:
            jacobian = _derivatives.at_point(pose, jacobian, self._checked_offset(offset, q))[1]
        hessian = _derivatives.hessian(jacobian, path.columns.to(q.device))
        if path.unfolded is None:
            return hessian
        return self._folding.fold(self._folding.fold(hessian).mT).mT

    def _checked(self, q: ArrayLike) -> Tensor:
        q = as_postures(q, self._n)
        if not q.is_cpu and (q.is_meta or not self._able.devices):
            raise UnsupportedDevice(
                f"posture q is on '{q.device}', and backend '{self.name}' "
                f"{'needs values' if q.is_meta else 'computes on the CPU'}; move it there yourself: q.cpu()"
            )
        return q

    def _checked_offset(self, offset: ArrayLike, q: Tensor) -> Tensor:
        point = as_float_tensor(offset, "offset")
        if point.shape not in ((3,), (*q.shape[:-1], 3)):
            wanted = "(3,)" if q.ndim == 1 else f"(3,) or {(*q.shape[:-1], 3)}"
            raise InvalidArray(f"offset has shape {tuple(point.shape)}; give a point in the link, {wanted}")
        if point.device != q.device:
            raise UnsupportedDevice(f"offset is on '{point.device}', posture q on '{q.device}'; move one of them")
        # What a transform of torch.func looks at has no values to be asked for.
        if torch._C._functorch.peek_interpreter_stack() is None and not bool(torch.isfinite(point).all()):
            raise InvalidArray("offset has NaN or infinite values; give points in the link [m]")
        return point

    def _at_point(self, q: Tensor, link: str, offset: Tensor, out: Out) -> tuple[Tensor, Tensor]:
        """Pose and Jacobian at a point fixed in the link."""
        if out is not None:
            if offset.requires_grad and torch.is_grad_enabled():
                raise NotDifferentiable(_NO_GRADIENT.format("offset"))
            self._check_out(q, out)
        # float32 is rounded once, at the end.
        wide = q.double() if q.is_cpu else q
        pose, jacobian = _derivatives.at_point(*self.pose_and_jacobian(wide, link), offset.to(wide.dtype))
        pose, jacobian = pose.to(q.dtype), jacobian.to(q.dtype)
        return (pose, jacobian) if out is None else (out[0].copy_(pose), out[1].copy_(jacobian))

    def _check_out(self, q: Tensor, out: Out) -> None:
        if q.requires_grad and torch.is_grad_enabled():
            raise NotDifferentiable(_NO_GRADIENT.format("q"))
        batch = tuple(q.shape[:-1])
        shapes = (*batch, 4, 4), (*batch, 6, self._n)
        if not (
            isinstance(out, tuple | list)
            and len(out) == 2
            and _holds(out[0], shapes[0], q)
            and _holds(out[1], shapes[1], q)
        ):
            raise InvalidArray(
                f"out must be (pose, jacobian), contiguous tensors of shapes {shapes[0]} and {shapes[1]}, of the dtype "
                f"and on the device of q ({str(q.dtype).removeprefix('torch.')}, {q.device}), without a gradient"
            )

    @cached_property
    def _folding(self) -> Folding:
        return Folding.of(self.robot)

    def _evaluate(self, backend: Kinematics, q: Tensor, link: str, out: Out = None) -> tuple[Tensor, Tensor]:
        """The backend's values. Few operations: with one posture each one counts."""
        if q.requires_grad:
            q = q.detach()
        # Not -1: a robot in which nothing moves has postures without values.
        flat = q if q.ndim == 2 else q.reshape(q.shape[:-1].numel(), q.shape[-1])
        if not self._able.finite:
            refuse_not_finite(flat)
        convert = q.dtype is not torch.float64 and q.is_cpu
        flat = (flat.to(torch.float64) if convert else flat).contiguous()
        if out is not None and self._able.out and not convert and q.is_cpu:
            views = out[0].view(-1, 4, 4), out[1].view(len(flat), 6, q.shape[-1])
            backend.pose_and_jacobian(flat, link, out=views)  # type: ignore[call-arg]
            return out[0], out[1]
        pose, jacobian = backend.pose_and_jacobian(flat, link)
        if convert:
            pose, jacobian = pose.to(q.dtype), jacobian.to(q.dtype)
        if q.ndim != 2:
            pose, jacobian = pose.reshape(*q.shape[:-1], 4, 4), jacobian.reshape(*q.shape[:-1], 6, q.shape[-1])
        if out is not None:
            return out[0].copy_(pose), out[1].copy_(jacobian)
        return pose, jacobian

    def _differentiable(self, q: Tensor, path: _Path, fold: bool = True) -> tuple[Tensor, Tensor]:
        """Pose and Jacobian with all their derivatives; with ``fold=False`` a column for each unfolded joint."""
        backend = path.unfolded or self.backend
        if path.unfolded is not None:
            q = self._folding.unfold(q)
        batch = q.shape[:-1]
        flat = q.reshape(batch.numel(), q.shape[-1])
        evaluate = partial(self._evaluate, backend, link=path.link)
        gradient: Callable[..., Tensor] | None = getattr(backend, "gradient", None) if self._able.gradient else None
        pose, jacobian = _derivatives.pose_and_jacobian(flat, path.columns.to(q.device), evaluate, gradient)
        pose, jacobian = pose.reshape(*batch, 4, 4), jacobian.reshape(*batch, 6, q.shape[-1])
        if fold and path.unfolded is not None:
            jacobian = self._folding.fold(jacobian)
        return pose, jacobian

    def _path(self, link: str) -> _Path:
        robot, unfolded = self.robot, self.robot.unfolded
        robot.check_link(link)
        free = unfolded is robot or (self._able.followers and all(joint.mimic is None for joint in robot.path(link)))
        columns = torch.tensor(moving_columns(robot if free else unfolded, link), dtype=torch.long)
        other = None if free else self._for_unfolded()
        path = self._paths[link] = _Path(link, free or self._able.followers, columns, other)
        return path

    def _for_unfolded(self) -> Kinematics:
        if not self._able.followers:
            return self.backend
        if self._unfolded_backend is None:
            # The protocol says that a backend is built from a robot alone.
            self._unfolded_backend = type(self.backend)(self.robot.unfolded)  # type: ignore[call-arg]
        return self._unfolded_backend


def _holds(tensor: Any, shape: tuple[int, ...], q: Tensor) -> bool:
    return (
        isinstance(tensor, Tensor)
        and tensor.shape == shape
        and tensor.dtype is q.dtype
        and tensor.device == q.device
        and tensor.is_contiguous()
        and not tensor.requires_grad
    )


def somebody_differentiates(q: Tensor) -> bool:
    """Whether autograd has to know: a backward, forward mode, or a transform of ``torch.func``."""
    return (
        (q.requires_grad and torch.is_grad_enabled())
        or torch.autograd.forward_ad._current_level >= 0
        or torch._C._functorch.peek_interpreter_stack() is not None
    )
