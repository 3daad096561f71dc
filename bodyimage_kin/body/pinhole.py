"""The pinhole camera in pixels, with OpenCV's lens distortion.

Camera axes: x to the image's right, y down, z forward. With ``u = (x/z, y/z)``, ``s = |u|^2`` and ``w = (p2, p1)``::

    d = u (1 + k1 s + k2 s^2 + k3 s^3) + s w + 2 (w . u) u,    pixel = (fx, fy) * d + (cx, cy)

which is OpenCV's model (calib3d, "Detailed Description") written with vectors. Pixels are counted from zero, a pixel's
number is its middle: an image of w x h pixels covers [-1/2, w - 1/2] x [-1/2, h - 1/2].

The polynomial describes a lens only as far as it grows with the angle. Beyond the angle where it turns back, it would
put what lies far aside into the image once more: such points have no image here, and a camera whose own image reaches
that far is refused.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from bodyimage_kin._arrays import ArrayLike, as_float_array, as_float_tensor
from bodyimage_kin._checks import number, numbers_of, refuse, whole
from bodyimage_kin.errors import FoldedLens, InvalidConfig

__all__ = ["Pinhole"]

_CONVERGED = 1e-11
"""Error of an undistorted pixel, projected again, that needs no further step [px]."""
_STEPS, _HALVINGS = 60, 30
_DIRECTIONS = 720
_LARGEST = 1e9
_SIDEWAYS = 1e8
"""A tangent from which on a direction is aside to rounding."""


@dataclass(frozen=True)
class Pinhole:
    """A pinhole camera with OpenCV's distortion; its images are in pixels.

    Attributes:
        fx: Focal length to the right [px].
        fy: Focal length down [px].
        cx: Column of the principal point [px].
        cy: Row of the principal point [px].
        distortion: k1, k2, p1, p2 and k3, in OpenCV's order; four numbers have k3 = 0, none no distortion.
        size: Width and height of the image [px]; None: not known, and everything in front is in view.
        near: Depth up to which nothing is seen [m].

    Raises:
        InvalidConfig: A focal length that is not positive, an image size that is not whole, another number of
            distortion coefficients.
        FoldedLens: A distortion that turns back inside of the image.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    size: tuple[int, int] | None = None
    near: float = 0.0

    m = 2
    unit = "px"
    names = ("u", "v")

    def __post_init__(self) -> None:
        for field in ("fx", "fy"):
            object.__setattr__(self, field, number(field, getattr(self, field), above=0.0))
        for field in ("cx", "cy"):
            object.__setattr__(self, field, number(field, getattr(self, field)))
        object.__setattr__(self, "near", number("near", self.near, least=0.0))
        given: ArrayLike = self.distortion
        distortion = numbers_of(
            "distortion", np.ravel(given) if hasattr(given, "shape") else given, least=-_LARGEST, most=_LARGEST
        )
        if len(distortion) not in (0, 4, 5):
            refuse("distortion", list(distortion), "k1, k2, p1, p2 and k3, OpenCV's model of five numbers, or none")
        object.__setattr__(self, "distortion", distortion + (0.0,) * (5 - len(distortion)))
        if self.size is not None:
            wide, high = self._pair()
            object.__setattr__(self, "size", (whole("size[0]", wide, least=1), whole("size[1]", high, least=1)))
            self._refuse_fold()

    @classmethod
    def from_matrix(
        cls,
        matrix: ArrayLike,
        distortion: ArrayLike = (),
        size: tuple[int, int] | None = None,
        near: float = 0.0,
    ) -> Pinhole:
        """A camera from the 3x3 matrix that ``cv2.calibrateCamera`` gives.

        Args:
            matrix: ``[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]`` [px].
            distortion: As of the class; an array of any shape.
            size: Width and height of the image [px].
            near: Depth up to which nothing is seen [m].

        Raises:
            InvalidConfig: A matrix of another form, as one with skew.
        """
        found = as_float_array(matrix, "camera matrix", shapes=((3, 3),), error=InvalidConfig)
        (fx, skew, cx), (zero, fy, cy), last = found
        if skew != 0.0 or zero != 0.0 or last.tolist() != [0.0, 0.0, 1.0]:
            raise InvalidConfig("camera matrix: give [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], without skew")
        numbers = as_float_array(distortion, "distortion", error=InvalidConfig).ravel().tolist()
        return cls(float(fx), float(fy), float(cx), float(cy), tuple(numbers), size, near)

    @property
    def matrix(self) -> Float[np.ndarray, "3 3"]:
        """``[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]`` [px]."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @cached_property
    def fold(self) -> float:
        """Tangent of the angle from the axis up to which the distortion describes a lens; inf: it never turns back."""
        return _fold(self.distortion)

    # The protocol ----------------------------------------------------------------------------------------------------

    def project(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 2"]:
        """The image [px] of points [m]; NaN behind the camera plane, and where the distortion has turned back."""
        has_image, u, v = self._directions(points)
        x, y = self._distorted(u, v)
        image = torch.stack([self.fx * x + self.cx, self.fy * y + self.cy], dim=-1)
        return torch.where(has_image[..., None], image, torch.nan)

    def derivative(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 2 3"]:
        """Derivative of :meth:`project` with respect to the points [px/m]; NaN where a point has no image."""
        has_image, u, v = self._directions(points)
        xu, xv, yv = self._slopes(u, v)
        rows = [
            torch.stack([focal * a, focal * b, -focal * (a * u + b * v)], dim=-1)
            for focal, a, b in ((self.fx, xu, xv), (self.fy, xv, yv))
        ]
        depth = torch.where(has_image, points[..., 2], 1.0)
        return torch.where(has_image[..., None, None], torch.stack(rows, dim=-2) / depth[..., None, None], torch.nan)

    def visible(self, points: Float[Tensor, "*batch 3"]) -> Bool[Tensor, "*batch"]:
        """Whether points [m] are deeper than the near plane and in the image."""
        image = self.project(points)
        seen = (points[..., 2] > self.near) & image.isfinite().all(-1)
        if self.size is None:
            return seen
        most = image.new_tensor(self.size) - 0.5
        return seen & ((image >= -0.5) & (image <= most)).all(-1)

    # The way back ----------------------------------------------------------------------------------------------------

    def undistort(self, pixels: ArrayLike) -> Float[Tensor, "*batch 2"]:
        """Where lines of sight run: (x/z, y/z) of what is seen at pixels, the inverse of :meth:`project`.

        By Newton's method, to 1e-10 px (or to rounding, where pixels are counted in millions).

        Args:
            pixels: ``(*batch, 2)`` [px]; where they are NaN, so is the result.

        Raises:
            FoldedLens: A pixel that no direction is seen at, beyond where the distortion turns back.
            InvalidConfig: Another shape.
        """
        image = as_float_tensor(pixels, "pixels", InvalidConfig)
        if image.ndim == 0 or image.shape[-1] != 2:
            raise InvalidConfig(f"pixels have shape {tuple(image.shape)}; give (*batch, 2)")
        flat = image.detach().reshape(-1, 2).to("cpu", torch.float64)
        known = flat.isfinite().all(-1)
        focal, middle = flat.new_tensor([self.fx, self.fy]), flat.new_tensor([self.cx, self.cy])
        wanted = torch.where(known[:, None], (flat - middle) / focal, 0.0)
        if bool((beyond := self._beyond(wanted.numpy())).any()):
            raise FoldedLens(
                f"pixel {flat[int(beyond.argmax())].tolist()} ({int(beyond.sum())} of {len(flat)}): no direction is "
                f"seen there; {self._said()}"
            )
        found = self._newton(wanted, focal)
        found[~known] = torch.nan
        return found.reshape(image.shape).to(image)

    def _newton(self, wanted: Float[Tensor, "count 2"], focal: Float[Tensor, "2"]) -> Float[Tensor, "count 2"]:
        """Directions whose distorted ones are wanted; every step brings each nearer, and stays where a lens is."""
        rounding = 4 * torch.finfo(torch.float64).eps * (wanted * focal).abs()
        inside = 0.5 * self.fold if math.isfinite(self.fold) else math.inf
        size = torch.linalg.vector_norm(wanted, dim=-1, keepdim=True)
        here = wanted * torch.where(size > inside, inside / size, 1.0)
        off = torch.stack(self._distorted(*here.unbind(-1)), -1) - wanted
        for _ in range(_STEPS):
            if bool(((off * focal).abs() <= rounding.clamp(min=_CONVERGED)).all()):
                break
            xu, xv, yv = self._slopes(*here.unbind(-1))
            x, y = off.unbind(-1)
            step = torch.stack([yv * x - xv * y, xu * y - xv * x], -1) / (xu * yv - xv * xv)[:, None]
            share = torch.ones_like(size)
            for _ in range(_HALVINGS):
                there = here - share * step
                left = torch.stack(self._distorted(*there.unbind(-1)), -1) - wanted
                worse = torch.linalg.vector_norm(left, dim=-1) > torch.linalg.vector_norm(off, dim=-1)
                worse |= torch.linalg.vector_norm(there, dim=-1) >= self.fold
                if not bool(worse.any()):
                    break
                share = torch.where(worse[:, None], 0.5 * share, share)
            here, off = torch.where(worse[:, None], here, there), torch.where(worse[:, None], off, left)
        return here

    # Inner -----------------------------------------------------------------------------------------------------------

    def _directions(self, points: Float[Tensor, "*batch 3"]) -> tuple[Tensor, Tensor, Tensor]:
        """Whether points have an image, and (x/z, y/z); these are finite and harmless where they have none."""
        x, y, depth = points.unbind(-1)
        has_image = depth > 0.0
        # Both branches of `where` are differentiated: the unseen one must be finite as well.
        safe = torch.where(has_image, depth, 1.0)
        u, v = x / safe, y / safe
        if math.isfinite(self.fold):
            has_image = has_image & (u * u + v * v < self.fold**2)
        return has_image, u, v

    def _distorted(self, u: Tensor, v: Tensor) -> tuple[Tensor, Tensor]:
        k1, k2, p1, p2, k3 = self.distortion
        s, along = u * u + v * v, 2.0 * (p1 * v + p2 * u)
        scale = 1.0 + s * (k1 + s * (k2 + s * k3)) + along
        return u * scale + p2 * s, v * scale + p1 * s

    def _slopes(self, u: Tensor, v: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """dx/du, dx/dv = dy/du, and dy/dv of the distorted direction (x, y)."""
        k1, k2, p1, p2, k3 = self.distortion
        s = u * u + v * v
        scale = 1.0 + s * (k1 + s * (k2 + s * k3)) + 2.0 * (p1 * v + p2 * u)
        steep = 2.0 * (k1 + s * (2.0 * k2 + s * (3.0 * k3)))
        return (
            scale + u * u * steep + 4.0 * p2 * u,
            u * v * steep + 2.0 * (p1 * u + p2 * v),
            scale + v * v * steep + 4.0 * p1 * v,
        )

    def _pair(self) -> tuple[object, object]:
        size: ArrayLike = self.size
        if isinstance(size, str | bytes) or not hasattr(size, "__len__") or len(size) != 2:
            refuse("size", size, "width and height in pixels, both whole")
        return size[0], size[1]

    def _refuse_fold(self) -> None:
        """Refuses a distortion that turns back before the image ends."""
        if not math.isfinite(self.fold) or self.size is None:
            return
        wide, high = self.size
        corners = np.array([[x, y] for x in (-0.5, wide - 0.5) for y in (-0.5, high - 0.5)])
        seen = (corners - [self.cx, self.cy]) / [self.fx, self.fy]
        # What lies inside of the border lies on a ray to a farther place of it: the border decides.
        edges = np.linspace(0.0, 1.0, 65)[:, None, None]
        border = (seen[[0, 1, 3, 2]] * (1.0 - edges) + seen[[1, 3, 2, 0]] * edges).reshape(-1, 2)
        if self._beyond(border).any():
            raise FoldedLens(
                f"distortion {list(self.distortion)} folds inside of the image of {wide} x {high} px; {self._said()}; "
                "give coefficients of a calibration that saw the whole image, or a smaller 'size'"
            )

    def _beyond(self, wanted: Float[np.ndarray, "count 2"]) -> Bool[np.ndarray, "count"]:
        """Which distorted directions nothing is seen at: outside of what the disc of directions becomes."""
        if not math.isfinite(self.fold):
            return np.zeros(len(wanted), dtype=bool)
        angle = np.linspace(-math.pi, math.pi, _DIRECTIONS + 1)
        rim = torch.from_numpy(self.fold * np.stack([np.cos(angle), np.sin(angle)]))
        x, y = (part.numpy() for part in self._distorted(*rim))
        found, radius = np.unwrap(np.arctan2(y, x)), np.hypot(x, y)
        turned = np.arctan2(wanted[:, 1], wanted[:, 0])
        reach = np.interp(turned, found, radius, period=2 * math.pi)
        return np.asarray(np.hypot(wanted[:, 0], wanted[:, 1]) >= reach)

    def _said(self) -> str:
        return f"the lens' distortion turns back {math.degrees(math.atan(self.fold)):.1f} degrees from its axis"


def _fold(distortion: tuple[float, ...]) -> float:
    """The least tangent t at which the distortion's derivative is singular in some direction; inf where in none.

    In the direction e, at angle a from w = (p2, p1), the derivative at ``t e`` is, in the axes along and across e,
    ``[[g + 6 c t, 2 b t], [2 b t, f + 2 c t]]`` with ``s = t^2``, ``f = 1 + k1 s + k2 s^2 + k3 s^3``,
    ``g = f + 2 s f'``, ``c = |w| cos a`` and ``b = |w| sin a``.
    """
    k1, k2, p1, p2, k3 = distortion
    f = np.polynomial.Polynomial([1.0, 0.0, k1, 0.0, k2, 0.0, k3])
    g = np.polynomial.Polynomial([1.0, 0.0, 3.0 * k1, 0.0, 5.0 * k2, 0.0, 7.0 * k3])
    t = np.polynomial.Polynomial([0.0, 1.0])
    aside = math.hypot(p1, p2)
    least = math.inf
    # Symmetric in a.
    for angle in np.linspace(0.0, math.pi, 181 if aside else 1):
        c, b = aside * math.cos(angle), aside * math.sin(angle)
        singular = (g + 6.0 * c * t) * (f + 2.0 * c * t) - 4.0 * b * b * t * t
        # Of 1/t: the polynomial begins with 1, so that coefficients of next to nothing do no harm.
        roots = np.roots(singular.coef)
        real = roots.real[(np.abs(roots.imag) <= 1e-7 * np.abs(roots)) & (roots.real > 0.0)]
        least = min(least, 1.0 / float(real.max()) if len(real) else math.inf)
    return least if least < _SIDEWAYS else math.inf
