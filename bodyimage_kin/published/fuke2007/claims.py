"""What the paper claims, what is measured, and whether it holds.

Every criterion stands here in code and in words; it looks at the interval, not at the mean. An interval is the 95 %
bias-corrected and accelerated bootstrap (Efron 1987) of the mean over recordings, the unit of resampling; it is missing
below three recordings.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.stats

from bodyimage_kin.published.fuke2007.cell import Cell
from bodyimage_kin.published.fuke2007.conditions import DIRECT

Groups = Mapping[str, Sequence[Cell]]
Interval = tuple[float, float]
_RESAMPLES = 2000


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
    values: Callable[[Groups], Sequence[float]]
    criterion: str
    holds: Callable[[float, float], bool]


def judge(groups: Groups) -> list[dict[str, Any]]:
    """Every claim as ``{name, statement, asked_by, measured, interval, criterion, holds}``.

    ``holds`` is None where there is no interval to decide by.
    """
    judged = []
    for claim in CLAIMS:
        values = np.asarray(claim.values(groups), dtype=float)
        measured, interval = float(np.mean(values)), bootstrap(values)
        judged.append(
            {
                "name": claim.name,
                "statement": claim.statement,
                "asked_by": claim.asked_by,
                "measured": measured,
                "interval": None if interval is None else list(interval),
                "criterion": claim.criterion,
                "holds": None if interval is None else bool(claim.holds(*interval)),
            }
        )
    return judged


def bootstrap(values: Sequence[float] | np.ndarray) -> Interval | None:
    """The 95 % interval of a mean over recordings; None below three of them or with one that is not finite."""
    sample = np.asarray(values, dtype=float)
    if len(sample) < 3 or not np.isfinite(sample).all():
        return None
    if np.ptp(sample) <= 1e-12 * max(1.0, float(np.abs(sample).max())):
        return float(sample.mean()), float(sample.mean())
    found = scipy.stats.bootstrap(
        (sample,), np.mean, n_resamples=_RESAMPLES, method="BCa", rng=np.random.default_rng(0)
    ).confidence_interval
    return float(found.low), float(found.high)


def _worst_correlation(condition: str) -> Callable[[Groups], Sequence[float]]:
    return lambda groups: [float(np.min(cell.scored["paper_mlp"].velocity_correlation)) for cell in groups[condition]]


def _log_ratio(
    upper: tuple[str, str], lower: tuple[str, str], score: Callable[[Any], float]
) -> Callable[[Groups], Sequence[float]]:
    """Logarithm of the ratio of one score, paired by seed; each side is (condition, estimator)."""

    def values(groups: Groups) -> Sequence[float]:
        pairs = zip(groups[upper[0]], groups[lower[0]], strict=True)
        return [float(np.log(score(a.scored[upper[1]]) / score(b.scored[lower[1]]))) for a, b in pairs]

    return values


def _of_map(condition: str, value: Callable[[Cell], float]) -> Callable[[Groups], Sequence[float]]:
    return lambda groups: [value(cell) for cell in groups[condition]]


def _falls(cell: Cell) -> float:
    errors = cell.mapped["paper_mlp"].topological_errors
    return errors[-1] / max(errors[0], 1)


def _other_first_maps(groups: Groups) -> Sequence[float]:
    return [float(row[-1] / max(row[0], 1.0)) for cell in groups["noisy_500"] for row in cell.other_maps]


def _displacement(scored: Any) -> float:
    return float(scored.displacement_error)


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
        _of_map("noisy_500", lambda cell: cell.scored["paper_mlp"].displacement_error),
        "relative displacement error on the face: interval below 0.2",
        lambda low, high: high < 0.2,
    ),
    Claim(
        "training_converges",
        "The network approximates the training data well from any first weights (section 3.2).",
        "paper",
        _of_map("noise_free_200", lambda cell: cell.scored["paper_mlp"].training_residual),
        "relative residual on the training displacements: interval below 0.2",
        lambda low, high: high < 0.2,
    ),
    Claim(
        "posture_has_little_effect",
        "The posture difference has little effect on the Jacobian (section 3.2).",
        "paper",
        _of_map("noise_free_200", lambda cell: cell.jacobian_change),
        "change of the mean true Jacobian from circle to face, in the motion's metric: interval below 0.2",
        lambda low, high: high < 0.2,
    ),
    Claim(
        "noise_needs_more_steps",
        "With noise the learning steps have to increase from 200 to 500 (section 4.1).",
        "paper",
        _log_ratio(("noisy_500", "paper_mlp"), ("noisy_200", "paper_mlp"), _displacement),
        "log ratio of displacement errors, 500 over 200 steps with noise: interval below log 0.95",
        lambda low, high: high < float(np.log(0.95)),
    ),
    Claim(
        "no_gain_without_noise",
        "Control of the above: without noise, 500 steps gain nothing over 200.",
        "us",
        _log_ratio(("noise_free_500", "paper_mlp"), ("noise_free_200", "paper_mlp"), _displacement),
        "log ratio of displacement errors, 500 over 200 steps without noise: interval above log 0.95",
        lambda low, high: low > float(np.log(0.95)),
    ),
    Claim(
        "relative_position_is_kept",
        "Relative positions of the landmarks are kept although the integral drifts (Fig. 9).",
        "paper",
        _of_map("noisy_500", lambda cell: cell.scored["paper_mlp"].relations_kept),
        "share of left-of and above relations that the estimated tour keeps: interval above 0.95",
        lambda low, high: low > 0.95,
    ),
    Claim(
        "topological_error_falls",
        "The topological error falls as the learning steps proceed (Fig. 11).",
        "paper",
        _of_map("noisy_500", _falls),
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
        _of_map("noisy_500", lambda cell: cell.mapped["paper_mlp"].edge_correlation),
        "rank correlation of touch counts with the map's error, over taxels: interval below -0.3",
        lambda low, high: high < -0.3,
    ),
    Claim(
        "jacobian_is_right_on_the_face",
        "The learned Jacobian is right where it is used.",
        "us",
        _of_map("noisy_500", lambda cell: cell.scored["paper_mlp"].jacobian_relative_error_use["on_face"]),
        "relative error on the face in the motion's metric: interval below 0.2",
        lambda low, high: high < 0.2,
    ),
    Claim(
        "map_has_the_right_size",
        "The map is as large as direct sight makes it.",
        "us",
        _of_map(
            "noisy_500",
            lambda cell: float(np.mean(cell.mapped["paper_mlp"].final["span"] / cell.mapped[DIRECT].final["span"])),
        ),
        "span over that of direct sight, mean of both axes: interval within 0.9 and 1.1",
        lambda low, high: low > 0.9 and high < 1.1,
    ),
    Claim(
        "map_is_not_folded",
        "No cell of the map is folded.",
        "us",
        _of_map("noisy_500", lambda cell: float(cell.mapped["paper_mlp"].final["folded_cells"])),
        "folded cells of 400 at the end: interval below 1",
        lambda low, high: high < 1.0,
    ),
    Claim(
        "map_has_the_right_shape",
        "But for its size, the map is as good as direct sight's.",
        "us",
        _of_map(
            "noisy_500",
            lambda cell: cell.mapped["paper_mlp"].final["disparity"] - cell.mapped[DIRECT].final["disparity"],
        ),
        "disparity minus that of direct sight: interval below 0.02",
        lambda low, high: high < 0.02,
    ),
    Claim(
        "network_beats_least_squares",
        "The network is better than one constant Jacobian by least squares.",
        "us",
        _log_ratio(("noisy_500", "paper_mlp"), ("noisy_500", "least_squares"), _displacement),
        "log ratio of displacement errors on the face: interval below 0",
        lambda low, high: high < 0.0,
    ),
    Claim(
        "network_beats_scaled_least_squares",
        "It is also better than least squares told the ratio of depths.",
        "us",
        _log_ratio(("noisy_500", "paper_mlp"), ("noisy_500", "least_squares_scaled"), _displacement),
        "log ratio of displacement errors on the face: interval below 0",
        lambda low, high: high < 0.0,
    ),
)
