"""What the paper claims, what is measured, and whether it holds.

Every criterion stands here in code and in words; it looks at the interval, not at the mean. An interval is that of
:func:`bodyimage_kin.study.statistics.interval` over recordings, the unit of resampling; it is missing below three of
them, or with one that is not finite.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Float

from bodyimage_kin.published.fuke2007.conditions import Conditions
from bodyimage_kin.published.fuke2007.grid import DIRECT, NETWORK
from bodyimage_kin.study import statistics

__all__ = ["CLAIMS", "Claim", "Values", "judged"]

Values: TypeAlias = Callable[[Conditions], Float[np.ndarray, "values"]]


@dataclass(frozen=True)
class Claim:
    """One statement of the paper, or one question it did not ask.

    Attributes:
        name: Its name in results.
        statement: In words.
        asked_by: ``"paper"`` or ``"us"``.
        values: One value a recording.
        criterion: When it holds, in words.
        holds: The same in code, on the interval's ends.
    """

    name: str
    statement: str
    asked_by: str
    values: Values
    criterion: str
    holds: Callable[[float, float], bool]


def judged(found: Conditions) -> list[dict[str, Any]]:
    """Every claim as ``{name, statement, asked_by, measured, interval, criterion, holds}``.

    ``holds`` is None where there is no interval to decide by.
    """
    every = []
    for claim in CLAIMS:
        values = np.asarray(claim.values(found), dtype=float)
        of = statistics.interval(values)
        ends = [of.lower, of.upper] if np.isfinite(values).all() and np.isfinite(of.lower) else None
        every.append(
            {
                "name": claim.name,
                "statement": claim.statement,
                "asked_by": claim.asked_by,
                "measured": float(np.mean(values)),
                "interval": ends,
                "criterion": claim.criterion,
                "holds": None if ends is None else bool(claim.holds(*ends)),
            }
        )
    return every


def _of(condition: str, score: str, **at: object) -> Values:
    return lambda found: found.score(condition, NETWORK, score, **at)


def _worst_correlation(condition: str) -> Values:
    return lambda found: found.score(condition, NETWORK, "velocity_correlation").min(axis=1)


def _log_ratio(upper: tuple[str, str], lower: tuple[str, str]) -> Values:
    """Logarithm of the ratio of displacement errors, paired by seed; each side is (condition, estimator)."""

    def values(found: Conditions) -> Float[np.ndarray, "seed"]:
        one, other = (found.score(*side, "displacement_error") for side in (upper, lower))
        return np.log(one / other)

    return values


def _falls(found: Conditions) -> Float[np.ndarray, "seed"]:
    errors = found.score("noisy_500", NETWORK, "topological_errors")[:, 0]
    return errors[:, -1] / np.maximum(errors[:, 0], 1.0)


def _other_first_maps(found: Conditions) -> Float[np.ndarray, "maps"]:
    errors = found.score("noisy_500", NETWORK, "topological_errors")[:, 1:].reshape(-1, found.results.sizes["snapshot"])
    errors = errors[np.isfinite(errors).all(1)]
    return errors[:, -1] / np.maximum(errors[:, 0], 1.0)


def _relative_span(found: Conditions) -> Float[np.ndarray, "seed"]:
    own, direct = (found.score("noisy_500", name, "spans")[:, -1] for name in (NETWORK, DIRECT))
    return (own / direct).mean(axis=1)


def _disparity_beyond_sight(found: Conditions) -> Float[np.ndarray, "seed"]:
    return found.score("noisy_500", NETWORK, "disparity") - found.score("noisy_500", DIRECT, "disparity")


CLAIMS: tuple[Claim, ...] = (
    Claim(
        "velocity_follows_noise_free",
        "Without noise the learned velocity follows the actual one (Fig. 8 a, b).",
        "paper",
        _worst_correlation("noise_free_200"),
        "velocity correlation of the worse axis: interval above 0.9",
        lambda low, high: low > 0.9,
    ),
    Claim(
        "velocity_follows_noisy",
        "With noise, after 500 steps, the learned velocity follows the actual one (Fig. 8 c, d).",
        "paper",
        _worst_correlation("noisy_500"),
        "velocity correlation of the worse axis: interval above 0.9",
        lambda low, high: low > 0.9,
    ),
    Claim(
        "velocity_has_the_right_size",
        "The estimated displacement is the right one, not only in step with it.",
        "us",
        _of("noisy_500", "displacement_error"),
        "relative displacement error on the face: interval below 0.2",
        lambda low, high: high < 0.2,
    ),
    Claim(
        "training_converges",
        "The network approximates the training data well from any first weights (section 3.2).",
        "paper",
        _of("noise_free_200", "training_residual"),
        "relative residual on the training displacements: interval below 0.2",
        lambda low, high: high < 0.2,
    ),
    Claim(
        "posture_has_little_effect",
        "The posture difference has little effect on the Jacobian (section 3.2).",
        "paper",
        lambda found: found.fact("noise_free", "jacobian_change"),
        "change of the mean true Jacobian from circle to face, in the motion's metric: interval below 0.2",
        lambda low, high: high < 0.2,
    ),
    Claim(
        "noise_needs_more_steps",
        "With noise the learning steps have to increase from 200 to 500 (section 4.1).",
        "paper",
        _log_ratio(("noisy_500", NETWORK), ("noisy_200", NETWORK)),
        "log ratio of displacement errors, 500 over 200 steps with noise: interval below log 0.95",
        lambda low, high: high < float(np.log(0.95)),
    ),
    Claim(
        "no_gain_without_noise",
        "Control of the above: without noise, 500 steps gain nothing over 200.",
        "us",
        _log_ratio(("noise_free_500", NETWORK), ("noise_free_200", NETWORK)),
        "log ratio of displacement errors, 500 over 200 steps without noise: interval above log 0.95",
        lambda low, high: low > float(np.log(0.95)),
    ),
    Claim(
        "relative_position_is_kept",
        "Relative positions of the landmarks are kept although the integral drifts (Fig. 9).",
        "paper",
        _of("noisy_500", "relations_kept"),
        "share of left-of and above relations that the estimated tour keeps: interval above 0.95",
        lambda low, high: low > 0.95,
    ),
    Claim(
        "topological_error_falls",
        "The topological error falls as the learning steps proceed (Fig. 11).",
        "paper",
        _falls,
        "topological error at the end over that at the start: interval below 0.1",
        lambda low, high: high < 0.1,
    ),
    Claim(
        "from_any_first_map",
        "It falls from any first map over one and the same recording (section 4.2).",
        "paper",
        _other_first_maps,
        "topological error at the end over that at the start, nine further first maps: interval below 0.1",
        lambda low, high: high < 0.1,
    ),
    Claim(
        "errors_at_rarely_touched_edges",
        "The errors that remain sit at rarely touched edges (section 4.2).",
        "paper",
        _of("noisy_500", "edge_correlation"),
        "rank correlation of touch counts with the map's error, over taxels: interval below -0.3",
        lambda low, high: high < -0.3,
    ),
    Claim(
        "jacobian_is_right_on_the_face",
        "The learned Jacobian is right where it is used.",
        "us",
        _of("noisy_500", "relative_error_use", probe="on_face"),
        "relative error on the face in the motion's metric: interval below 0.2",
        lambda low, high: high < 0.2,
    ),
    Claim(
        "map_has_the_right_size",
        "The map is as large as direct sight makes it.",
        "us",
        _relative_span,
        "span over that of direct sight, mean of both axes: interval within 0.9 and 1.1",
        lambda low, high: low > 0.9 and high < 1.1,
    ),
    Claim(
        "map_is_not_folded",
        "No cell of the map is folded.",
        "us",
        _of("noisy_500", "folded_cells"),
        "folded cells of 400 at the end: interval below 1",
        lambda low, high: high < 1.0,
    ),
    Claim(
        "map_has_the_right_shape",
        "But for its size, the map is as good as direct sight's.",
        "us",
        _disparity_beyond_sight,
        "disparity minus that of direct sight: interval below 0.02",
        lambda low, high: high < 0.02,
    ),
    Claim(
        "network_beats_least_squares",
        "The network is better than one constant Jacobian by least squares.",
        "us",
        _log_ratio(("noisy_500", NETWORK), ("noisy_500", "least_squares")),
        "log ratio of displacement errors on the face: interval below 0",
        lambda low, high: high < 0.0,
    ),
    Claim(
        "network_beats_scaled_least_squares",
        "It is also better than least squares told the ratio of depths.",
        "us",
        _log_ratio(("noisy_500", NETWORK), ("noisy_500", "least_squares_scaled")),
        "log ratio of displacement errors on the face: interval below 0",
        lambda low, high: high < 0.0,
    ),
)
