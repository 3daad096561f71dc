"""What the paper claims, what is measured, and whether it holds.

Every criterion stands here, in code and in words, and nowhere else: the history of this file shows when it was set. It
looks at the interval, not at the mean. An interval is that of :func:`bodyimage_kin.study.statistics.interval` over
recordings, the unit of resampling; it is missing where they are too few, or with one that is not finite.

Each claim about what is learned is also put to the null estimators (:data:`~bodyimage_kin.published.fuke2007.NULLS`):
true Jacobians that are spoiled beyond use. A claim that one of them meets says nothing for whoever else meets it: it
cannot fail, and is never counted as holding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Float

from bodyimage_kin.published.fuke2007.conditions import Conditions
from bodyimage_kin.published.fuke2007.grid import DIRECT, NETWORK, NULLS
from bodyimage_kin.study import statistics

__all__ = ["CLAIMS", "Claim", "Values", "judged"]

Values: TypeAlias = Callable[[Conditions, str], Float[np.ndarray, "values"]]
"""Of the results and the estimator that the claim is put to: the paper's network, or a null."""


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
        learned: Whether it is about what is learned; one about the recordings alone has no nulls.
    """

    name: str
    statement: str
    asked_by: str
    values: Values
    criterion: str
    holds: Callable[[float, float], bool]
    learned: bool = True


def judged(found: Conditions) -> list[dict[str, Any]]:
    """Every claim with what came out.

    Returns:
        ``name``, ``statement``, ``asked_by`` and ``criterion``; ``measured``, the mean of the values, ``least`` and
        ``most`` of them, and ``interval``. ``met`` is whether the paper's network meets the criterion, ``passed_by``
        names the null estimators that do. ``holds`` is False for a claim that one of them passes, which ``cannot_fail``
        marks; None where there is no interval to decide by.
    """
    every = []
    for claim in CLAIMS:
        values, ends, met = _decided(claim, found, NETWORK)
        passed_by = [null for null in NULLS if _decided(claim, found, null)[2]] if claim.learned else []
        every.append(
            {
                "name": claim.name,
                "statement": claim.statement,
                "asked_by": claim.asked_by,
                "measured": float(np.mean(values)),
                "least": float(np.min(values)),
                "most": float(np.max(values)),
                "interval": ends,
                "criterion": claim.criterion,
                "met": met,
                "passed_by": passed_by,
                "cannot_fail": bool(passed_by),
                "holds": met and not passed_by if met is not None else None,
            }
        )
    return every


def _decided(
    claim: Claim, found: Conditions, estimator: str
) -> tuple[Float[np.ndarray, "values"], list[float] | None, bool | None]:
    """Values of a claim put to an estimator, the ends of their interval, and whether these meet the criterion."""
    values = np.asarray(claim.values(found, estimator), dtype=float)
    of = statistics.interval(values)
    if not np.isfinite(values).all() or not np.isfinite(of.lower):
        return values, None, None
    return values, [of.lower, of.upper], bool(claim.holds(of.lower, of.upper))


def _of(condition: str, score: str, **at: object) -> Values:
    return lambda found, estimator: found.score(condition, estimator, score, **at)


def _worst_correlation(condition: str) -> Values:
    return lambda found, estimator: found.score(condition, estimator, "velocity_correlation").min(axis=1)


def _log_ratio(upper: str, lower: str, rival: str = "") -> Values:
    """Logarithm of the ratio of displacement errors, paired by seed, of two conditions; of a rival in the second."""

    def values(found: Conditions, estimator: str) -> Float[np.ndarray, "seed"]:
        one = found.score(upper, estimator, "displacement_error")
        return np.log(one / found.score(lower, rival or estimator, "displacement_error"))

    return values


def _falls(found: Conditions, estimator: str) -> Float[np.ndarray, "seed"]:
    errors = found.score("noisy_500", estimator, "topological_errors")[:, 0]
    return errors[:, -1] / np.maximum(errors[:, 0], 1.0)


def _other_first_maps(found: Conditions, estimator: str) -> Float[np.ndarray, "maps"]:
    errors = found.score("noisy_500", estimator, "topological_errors")[:, 1:].reshape(
        -1, found.results.sizes["snapshot"]
    )
    errors = errors[np.isfinite(errors).all(1)]
    return errors[:, -1] / np.maximum(errors[:, 0], 1.0)


def _relative_span(found: Conditions, estimator: str) -> Float[np.ndarray, "seed"]:
    own, direct = (found.score("noisy_500", name, "spans")[:, -1] for name in (estimator, DIRECT))
    return (own / direct).mean(axis=1)


def _disparity_beyond_sight(found: Conditions, estimator: str) -> Float[np.ndarray, "seed"]:
    return found.score("noisy_500", estimator, "disparity") - found.score("noisy_500", DIRECT, "disparity")


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
        lambda found, estimator: found.fact("noise_free", "jacobian_change"),
        "change of the mean true Jacobian from circle to face, in the motion's metric: interval below 0.2",
        lambda low, high: high < 0.2,
        learned=False,
    ),
    Claim(
        "noise_needs_more_steps",
        "With noise the learning steps have to increase from 200 to 500 (section 4.1).",
        "paper",
        _log_ratio("noisy_500", "noisy_200"),
        "log ratio of displacement errors, 500 over 200 steps with noise: interval below log 0.95",
        lambda low, high: high < float(np.log(0.95)),
    ),
    Claim(
        "no_gain_without_noise",
        "Control of the above: without noise, 500 steps gain nothing over 200.",
        "us",
        _log_ratio("noise_free_500", "noise_free_200"),
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
        _log_ratio("noisy_500", "noisy_500", "least_squares"),
        "log ratio of displacement errors on the face: interval below 0",
        lambda low, high: high < 0.0,
    ),
    Claim(
        "network_beats_scaled_least_squares",
        "It is also better than least squares told the ratio of depths.",
        "us",
        _log_ratio("noisy_500", "noisy_500", "least_squares_scaled"),
        "log ratio of displacement errors on the face: interval below 0",
        lambda low, high: high < 0.0,
    ),
)
