"""Whether the mounted units of a skin, such as triangles of ten taxels, are where they are said to be.

A unit that was screwed on elsewhere, turned about, or wired under another's number is felt in one place and published
in another. What all units share (place, turn and size of the map) is fitted first, robustly; so is how far units are
off on the mean, for no map is free of warps. Misplaced is what is farther off than that and than its touches spread.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.stats
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from bodyimage_kin._arrays import ArrayLike, Floats, as_pair
from bodyimage_kin._checks import number, whole
from bodyimage_kin._holm import holm
from bodyimage_kin._shown import Shown
from bodyimage_kin.errors import InvalidArray
from bodyimage_kin.metrics.maps import procrustes

__all__ = ["MisplacedUnits", "misplaced_units"]

FEWEST = 8
"""Touches below which nothing is said of a unit: a bootstrap of fewer often draws two places alone."""
_ROUNDING = 1e-9
"""Of the skin's size: what counts as no spread at all."""


@dataclass(frozen=True, eq=False)
class MisplacedUnits(Shown):
    """What a map says of each unit that was touched, in the frame and unit of the published places.

    Attributes:
        units: Number of each unit, ascending.
        touches: How many rows it has.
        displacement: From where it is published to where it is felt; NaN with fewer than 8 touches.
        spread: Of its displacement over the bootstrap of its touches, root of the summed variances.
        scatter: Median distance of its touches from where it is felt. Many spacings of taxels: it is felt in several
            places, and a displacement says little.
        turn: How far it is turned about its own middle [rad], anticlockwise in the plane; in space the angle alone.
        turn_spread: Of its turn, likewise [rad].
        p_moved: That it is where it is published, adjusted (Holm) over all units, moved and turned; NaN: too few
            touches.
        p_turned: That it is not turned, likewise.
        moved: Whether p_moved is at most the level.
        turned: Whether p_turned is at most the level.
        nearest: The unit whose published place is nearest to where it is felt; its own number where that is its own.
        scale: Size of the map over that of the published places.
        warp: How far units are off on the mean beyond their spread, along each axis: what counts as the map's own.
        turn_warp: How far they are turned, likewise [rad].
    """

    units: Int[np.ndarray, "units"]
    touches: Int[np.ndarray, "units"]
    displacement: Float[np.ndarray, "units d"]
    spread: Float[np.ndarray, "units"]
    scatter: Float[np.ndarray, "units"]
    turn: Float[np.ndarray, "units"]
    turn_spread: Float[np.ndarray, "units"]
    p_moved: Float[np.ndarray, "units"]
    p_turned: Float[np.ndarray, "units"]
    moved: Bool[np.ndarray, "units"]
    turned: Bool[np.ndarray, "units"]
    nearest: Int[np.ndarray, "units"]
    scale: float
    warp: float
    turn_warp: float

    @property
    def misplaced(self) -> Int[np.ndarray, "found"]:
        """Numbers of the units that moved or turned."""
        return self.units[self.moved | self.turned]

    @property
    def places(self) -> dict[int, int]:
        """Unit that moved -> the other unit in whose published place it is felt, where it is nearest to another's."""
        swapped = self.moved & (self.nearest != self.units)
        return dict(zip(self.units[swapped].tolist(), self.nearest[swapped].tolist(), strict=True))


def misplaced_units(
    map: ArrayLike,
    places: ArrayLike,
    units: ArrayLike,
    *,
    level: float | int = 0.05,
    resamples: int = 500,
    seed: int = 0,
) -> MisplacedUnits:
    """Mounted units of a skin whose published place cannot be where they are felt.

    A similarity that gives little weight to what it does not fit carries the map to the published places. Displacement
    and turn of each unit are then held against the bootstrap over its touches and against what is common among the
    units: Hotelling's T squared with the variance of the bootstrap and, by the median over units, that of the map's own
    warps. Some touches may be from anywhere, as long as most are not. Touches count as independent of one another. In
    simulation fewer than one draw in twenty finds anything where nothing moved; a warp of the map costs power.

    Args:
        map: Where each touch was felt, (touches, d): the hand that a learned kinematics foretells or a body sees; d = 2
            in an image, 3 in space; any unit. Or the map of each taxel, (taxels, d).
        places: Where the taxels that it activated are published (their middle), (touches, d), in a frame and unit of
            their own.
        units: The unit of those taxels, (touches,) whole numbers, as :attr:`bodyimage_kin.body.Skin.units`; -1: none,
            left out, as are rows that are not finite.
        level: The chance that any unit at all is found where all are in their places.
        resamples: Draws of the bootstrap.
        seed: Of the draws.

    Returns:
        One entry a unit that was touched.

    Raises:
        InvalidArray: Shapes that do not fit together, units that are no whole numbers, or places all in one point.
        InvalidConfig: A level outside of (0, 1), or fewer than 100 resamples.
    """
    felt, published, unit = _rows(map, places, units)
    level = number("level", level, above=0.0, below=1.0)
    resamples = whole("resamples", resamples, least=100)
    felt, scale = _carried(felt, published)
    names, row = np.unique(unit, return_inverse=True)
    of = [np.flatnonzero(row == index) for index in range(len(names))]
    rng = np.random.default_rng(seed)
    drawn = [_bootstrapped(felt[one], published[one], resamples, rng) for one in of if len(one) >= FEWEST]
    shifts, turns = [shift for shift, _ in drawn], [turn for _, turn in drawn]
    count = np.array([len(one) for one in of])
    told = count >= FEWEST
    moved = _judged(shifts, count[told], _ROUNDING * np.ptp(published, axis=0).max())
    turned = _judged(turns, count[told], _ROUNDING)
    p = holm(np.concatenate([moved.p, turned.p]))
    p_moved, p_turned = (_spread_out(half, told) for half in np.split(p, 2))
    middles = np.stack([published[one].mean(0) for one in of])
    displacement = np.full(middles.shape, np.nan)
    displacement[told] = np.array([draws[0] for draws in shifts]).reshape(-1, middles.shape[1])
    off = felt - published - displacement[row]
    scatter = np.array([np.median(np.linalg.norm(off[one], axis=1)) for one in of])
    angle = np.array([draws[0, 0] if draws.shape[1] == 1 else np.linalg.norm(draws[0]) for draws in turns])
    at = np.where(told[:, None], middles + displacement, middles)
    nearest = names[np.linalg.norm(at[:, None] - middles, axis=-1).argmin(axis=1)]
    return MisplacedUnits(
        units=names,
        touches=count,
        displacement=displacement,
        spread=_spread_out(moved.spread, told),
        scatter=scatter,
        turn=_spread_out(angle, told),
        turn_spread=_spread_out(turned.spread, told),
        p_moved=p_moved,
        p_turned=p_turned,
        moved=p_moved <= level,
        turned=p_turned <= level,
        nearest=nearest,
        scale=scale,
        warp=moved.warp,
        turn_warp=turned.warp,
    )


def _rows(map: ArrayLike, places: ArrayLike, units: ArrayLike) -> tuple[Floats, Floats, Int[np.ndarray, "touches"]]:
    """Rows that are finite and of a unit."""
    felt, published = as_pair(map, places, ("map", "places"), ndim=2)
    unit = np.asarray(units)
    if felt.ndim != 2 or felt.shape[1] not in (2, 3) or unit.shape != felt.shape[:1] or unit.dtype.kind not in "iu":
        raise InvalidArray(
            f"map has shape {felt.shape}, units {unit.shape} of {unit.dtype}; give (touches, 2) or (touches, 3), and a "
            "whole number a touch"
        )
    used = np.isfinite(felt).all(1) & np.isfinite(published).all(1) & (unit >= 0)
    felt, published = felt[used], published[used]
    if len(published) == 0 or not np.ptp(published, axis=0).max() > 0:
        raise InvalidArray("no two touches are published in different places; give touches of several units")
    return felt, published, unit[used].astype(np.int64)


def _carried(felt: Floats, published: Floats) -> tuple[Floats, float]:
    """The map in the frame of the published places, by a similarity that weighs down what does not fit; its scale."""
    weight = np.ones(len(felt))
    tiny = _ROUNDING * np.ptp(published, axis=0).max()
    back, scale = felt, 1.0
    for step in range(40):
        # Of the truth to the map, whose noise would shrink it otherwise.
        fit = procrustes(felt, published, weight)
        if not fit.scale > 0:
            raise InvalidArray("the map is collapsed, or turned inside out: no similarity carries it to the places")
        middles = [weight @ one / weight.sum() for one in (felt, published)]
        back, scale = (felt - middles[0]) @ fit.rotation / fit.scale + middles[1], fit.scale
        off = np.maximum(np.linalg.norm(back - published, axis=1), tiny)
        # Sums of distances first, which have one minimum; then Cauchy's weights, to which what is far is nothing.
        weight = 1 / off if step < 15 else 1 / (1 + (off / (2 * np.median(off))) ** 2)
        weight = weight / weight.max()
    return back, scale


def _bootstrapped(
    felt: Floats, published: Floats, resamples: int, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "draws d"], Float[np.ndarray, "draws turns"]]:
    """Displacement and rotation vector of one unit; the first is that of all its touches, then those of the draws.

    Rotations of draws are about that of all touches, so that none is cut at half a turn.
    """
    n = len(felt)
    counts = np.concatenate([np.ones((1, n)), rng.multinomial(n, np.full(n, 1 / n), resamples)])
    off = felt - published
    cut = max(1.5 * float(np.median(np.linalg.norm(off - np.median(off, axis=0), axis=1))), 1e-300)
    shift = counts @ off / n
    weight = counts
    for _ in range(10):
        # Huber's weights.
        away = np.sqrt(sum((off[:, axis] - shift[:, axis, None]) ** 2 for axis in range(off.shape[1])))
        weight = counts * np.where(away > cut, cut / np.maximum(away, cut), 1.0)
        shift = weight @ off / weight.sum(1, keepdims=True)
    weight = weight / weight.sum(1, keepdims=True)
    x, y = (one - (weight @ one)[:, None] for one in (published, felt))
    U, _, Vt = np.linalg.svd((weight[..., None] * y).swapaxes(1, 2) @ x)
    U[..., -1] *= np.sign(np.linalg.det(U @ Vt))[:, None]
    rotation = U @ Vt
    all_of_it = _vector(rotation[:1])
    return shift, np.concatenate([all_of_it, all_of_it + _vector(rotation[1:] @ rotation[0].T)])


def _vector(rotation: Float[np.ndarray, "draws d d"]) -> Float[np.ndarray, "draws turns"]:
    if rotation.shape[-1] == 2:
        return np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0])[:, None]
    return Rotation.from_matrix(rotation).as_rotvec()


@dataclass(frozen=True)
class _Judged:
    p: Float[np.ndarray, "told"]
    spread: Float[np.ndarray, "told"]
    warp: float


def _judged(draws: list[Float[np.ndarray, "draws d"]], touches: Int[np.ndarray, "told"], tiny: float) -> _Judged:
    """How each unit's value, the first of its draws, stands against its draws and against the other units."""
    if not draws:
        return _Judged(np.zeros(0), np.zeros(0), float("nan"))
    value = np.stack([one[0] for one in draws])
    d = value.shape[1]
    off = np.stack([one[1:] - one[0] for one in draws])
    covariance = np.einsum("ubi,ubj->uij", off, off) / off.shape[1] * (touches / (touches - 1))[:, None, None]
    variance, axes = np.linalg.eigh(covariance)
    along = np.einsum("uij,ui->uj", axes, value) ** 2
    variance = np.maximum(variance, 0) + tiny**2
    to_f = (touches - d) / (d * (touches - 1))

    def ratio(warp: float) -> Float[np.ndarray, "told"]:
        return (along / (variance + warp)).sum(1) * to_f

    expected = scipy.stats.f.median(d, touches - d)
    low, high = 0.0, float(along.sum(1).max()) + tiny**2
    if np.median(ratio(0.0) / expected) > 1:
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if np.median(ratio(middle) / expected) > 1 else (low, middle)
    # The warp is known from so many units only.
    free = np.maximum(np.minimum(touches, len(draws)) - d, 1) if low > 0 else touches - d
    return _Judged(scipy.stats.f.sf(ratio(low), d, free), np.sqrt(np.trace(covariance, axis1=1, axis2=2)), low**0.5)


def _spread_out(values: Float[np.ndarray, "told"], told: Bool[np.ndarray, "units"]) -> Float[np.ndarray, "units"]:
    """In the places of those that are told of, NaN elsewhere."""
    found = np.full(len(told), np.nan)
    found[told] = values
    return found
