"""The body image: which image of the hand belongs to each taxel, and to each posture (equations 12 to 16).

Both maps learn online as a self-organizing map does, but with a winner that is given: the touched taxel, and the unit
of the posture map nearest to the felt posture. What they learn from is an estimate of the hand image; handing them the
true one instead is "direct sight", the best that this rule can do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from bodyimage_kin._compiled import in_threads
from bodyimage_kin._shown import Shown
from bodyimage_kin.body_image._checks import choice, float_array, grid_shape, number, whole
from bodyimage_kin.body_image._layout import Layout, Units, winning
from bodyimage_kin.body_image._learning import learn, learn_by_distance
from bodyimage_kin.body_image._touches import image_bounds, images_known, silent, touches
from bodyimage_kin.body_image.kernel import KERNELS, exponents
from bodyimage_kin.body_image.posture_som import PostureSOM
from bodyimage_kin.errors import InvalidConfig, InvalidRecording

__all__ = ["ALPHAS", "SILENCE_MODES", "SNAPSHOTS", "BodyImage"]

ALPHAS = ("geometric", "constant", "per_visit")
SILENCE_MODES = ("touch", "taxel")
SNAPSHOTS = (0, 1200, 2400, 3600, 4800, 7200, 8000)

_ALPHA_START, _ALPHA_END, _ALPHA_CONSTANT = 0.3, 0.02, 0.1
_GAMMA_POSTURE = 40.0 * (8 / 21) ** 2


@dataclass(frozen=True, eq=False)
class BodyImage(Shown):
    """What a robot learned of its own body by touching it.

    Attributes:
        tactile_map: (rows, columns, m) of a grid, (taxels, m) of any other skin: image of each taxel, in the unit of
            the hand image (equation 12).
        postures: (posture rows, posture columns, p) representative postures [rad or m].
        posture_map: (posture rows, posture columns, m) image of each of them [m on the screen] (equation 14).
        touch_counts: (number of taxels,) touches that taught something, by touched taxel.
        history: ``steps`` (snapshots,), map steps done, the last one always included; ``tactile_maps``
            (snapshots, *tactile_map) and ``posture_maps`` (snapshots, posture rows, posture columns, m) [m].
        config: Every setting, by name; numbers, strings and lists.
    """

    tactile_map: Float[np.ndarray, "... m"]
    postures: Float[np.ndarray, "posture_rows posture_columns p"]
    posture_map: Float[np.ndarray, "posture_rows posture_columns m"]
    touch_counts: Int[np.ndarray, " taxels"]
    history: dict[str, np.ndarray]
    config: dict[str, Any]

    @classmethod
    def learn(
        cls,
        exp: Any,
        hand: Any,
        trial: int = 0,
        skin: Units = (21, 21),
        seed: int = 0,
        *,
        kernel: str = "squared",
        gamma: float | int = 40.0,
        gamma_posture: float | int | None = None,
        alpha: str = "geometric",
        gamma_final: float | int | None = None,
        silence: float | int = 0.0,
        silence_mode: str = "touch",
        posture_grid: Any = (8, 8),
        snapshots: Any = SNAPSHOTS,
        initial_map: Any = None,
        image_range: Any = None,
        posture_som: PostureSOM | None = None,
        winners: str | None = None,
        steps: int | None = None,
    ) -> BodyImage:
        """Learn both maps from one trial, one step a sample: ``w_i += alpha(t) h(d_ic) (hand - w_i)`` (13, 15).

        A sample without touch, one whose hand is NaN and a silent one count as steps and teach nothing; padded samples
        are no steps. Initial weights, silence and posture map have random streams of their own.

        On a skin that is no grid distances run along its graph, in spacings; where several taxels are felt at once d is
        that to the nearest of them, ``h = max_c s_c h(d_ic)`` with their intensities s over the strongest; and gamma
        falls to 1, as a kernel that stays wide draws a map together.

        Args:
            exp: Experience: ``q`` (trial, time, joint) [rad or m], NaN where padded; ``touched`` (trial, time,
                contact), -1 none; ``intensity`` likewise, where recorded; ``hand_image`` (trial, time, axis) [m], which
                only bounds the initial weights.
            hand: Hand image to learn from [m on the screen], (trial, time, axis): an array or a DataArray.
            trial: Which trial.
            skin: (rows, columns) of a grid of taxels, a Skin, or distances between taxels (taxels, taxels).
            seed: Of everything random here.
            kernel: h: ``"squared"`` exp(-d^2 / gamma) (equation 16) or ``"plain"`` exp(-d / gamma) (13, 15), d in grid
                units.
            gamma: Width of the tactile map's kernel.
            gamma_posture: Width of the posture map's; by default 40 (8/21)^2.
            alpha: ``"geometric"`` from 0.3 at the first step to 0.02 at the last, ``"constant"`` 0.1, or
                ``"per_visit"``, one over the visits that the winner has had.
            gamma_final: Anneal gamma geometrically to this value at the last step, gamma_posture by the same factor;
                None: gamma stays on a grid, and falls to 1 (gamma_posture stays) on any other skin.
            silence: Probability that sensors say nothing, beside touches that the recording itself leaves silent.
            silence_mode: ``"touch"``: a whole touch goes unnoticed. ``"taxel"``: every taxel is silent by itself at
                every step and then does not learn; the others and the posture map still feel the touch.
            posture_grid: (rows, columns) of the posture map.
            snapshots: Steps at which the history keeps the maps; those beyond the recording are dropped.
            initial_map: Tactile map at step 0 [m]; by default uniform over the image range.
            image_range: (m, 2) lowest and highest of each axis [m]; by default that of the experienced hand image,
                or of ``hand`` when no hand was ever seen.
            posture_som: A trained posture map; by default one is trained on the trial's touching postures.
            winners: Which of the taxels felt at once win: the ``"first"`` (as always on a grid), ``"all"`` (the default
                of distances), the single ``"largest"`` cluster, without which a touch teaches nothing (that of a
                Skin that is no grid), or the one taxel in its ``"middle"``: with a hand that covers many taxels at once
                all of them learn the same place, and the map is drawn together.
            steps: Learn from so many samples, each drawn anew from all of the trial, as from a set without an order;
                None: from each once, in turn.

        Raises:
            InvalidRecording: A variable is missing, no samples, no touches, or a taxel that is none of the skin.
            InvalidArray: ``hand``, ``initial_map`` or ``image_range`` has the wrong shape.
            InvalidConfig: A setting out of its range, or no such trial; lists the valid ones.
        """
        layout, posture_shape = Layout.of(skin), grid_shape("posture_grid", posture_grid)
        shape, rule = layout.shape, layout.winners(winners)
        gamma_posture = _GAMMA_POSTURE if gamma_posture is None else gamma_posture
        choice("kernel", kernel, KERNELS)
        choice("alpha", alpha, ALPHAS)
        choice("silence_mode", silence_mode, SILENCE_MODES)
        silence = number("silence", silence, 0.0, 1.0)
        gamma = number("gamma", gamma, 0.0, open_below=True)
        gamma_posture = number("gamma_posture", gamma_posture, 0.0, open_below=True)
        if gamma_final is not None:
            gamma_final = number("gamma_final", gamma_final, 0.0, open_below=True)
        whole("seed", seed, 0)

        q, touched, target, intensity = touches(exp, hand, trial, layout)
        active, strengths = winning(layout, rule, touched, None if layout.grid else intensity)
        taxels = active[:, 0]
        weights_stream, silence_stream, som_stream, order_stream = np.random.SeedSequence(seed).spawn(4)
        if steps is not None:
            drawn = np.random.default_rng(order_stream).integers(len(q), size=whole("steps", steps, 1))
            q, active, strengths, target = q[drawn], active[drawn], strengths[drawn], target[drawn]
            taxels = active[:, 0]
        steps, m = target.shape
        kept = _snapshots(snapshots, steps)
        if not (taxels >= 0).any():
            raise InvalidRecording(f"trial {trial} has no touches, so there is nothing to map")
        draw = np.random.default_rng(weights_stream)
        lowest, highest = image_bounds(images_known(exp, hand), m, image_range).T
        initial = draw.uniform(lowest, highest, (*shape, m))
        if initial_map is not None:
            initial = float_array("initial_map", initial_map, (*shape, m))
        initial_posture = draw.uniform(lowest, highest, (*posture_shape, m))

        given_som = posture_som is not None
        if posture_som is None:
            posture_som = PostureSOM.fit(q[taxels >= 0], posture_shape, int(som_stream.generate_state(1)[0]))
        elif posture_som.postures.shape[:2] != posture_shape:
            raise InvalidConfig(
                f"posture_grid={posture_shape} but posture_som is {posture_som.postures.shape[:2]}; give the same"
            )

        taught = np.isfinite(target).all(axis=1) & (taxels >= 0)
        speaking = None
        if silence_mode == "touch":
            taught &= ~silent(steps, silence, silence_stream)
        else:
            draws = np.random.default_rng(silence_stream).random((steps, *shape), dtype=np.float32)
            speaking = draws >= silence
        active = np.where(taught[:, None], active, -1)
        taxels = active[:, 0]
        posture_winners = np.full(steps, -1)
        posture_winners[taught] = posture_som.winners(q[taught])

        posture_decay = 1.0 if gamma_final is None else gamma_final / gamma
        decay = min(1.0 / gamma, 1.0) if gamma_final is None and layout.grid is None else posture_decay
        progress = np.arange(steps) / max(steps - 1, 1)
        rates, gammas = _rates(alpha, progress, taxels), gamma * decay**progress
        if layout.grid is None:
            tactile_maps = _learn_on_skin(
                initial, active, strengths, target, rates, gammas, layout.exponents(kernel), speaking, kept
            )
        else:
            tactile_maps = _learn_map(
                initial, taxels, target, rates, gammas, exponents(layout.grid, kernel), speaking, kept
            )
        posture_maps = _learn_map(
            initial_posture, posture_winners, target, _rates(alpha, progress, posture_winners),
            gamma_posture * posture_decay**progress, exponents(posture_shape, kernel), None, kept,
        )  # fmt: skip
        return cls(
            tactile_map=tactile_maps[-1],
            postures=posture_som.postures,
            posture_map=posture_maps[-1],
            touch_counts=np.bincount(active[active >= 0], minlength=layout.count),
            history={"steps": np.array(kept), "tactile_maps": tactile_maps, "posture_maps": posture_maps},
            config={
                "trial": trial, "skin": list(shape), "winners": rule, "seed": seed, "kernel": kernel, "gamma": gamma,
                "gamma_posture": gamma_posture, "gamma_final": gamma_final, "alpha": alpha, "silence": silence,
                "silence_mode": silence_mode, "posture_grid": list(posture_shape),
                "image_range": np.stack([lowest, highest], axis=1).tolist(),
                "initial_map": "random" if initial_map is None else "given",
                "posture_som": "given" if given_som else "trained",
            },
        )  # fmt: skip

    @classmethod
    def learn_many(
        cls, exps: Sequence[Any], hands: Sequence[Any], seeds: Sequence[int], **settings: Any
    ) -> list[BodyImage]:
        """Learn maps of several experiences, one seed each, in as many threads as torch is allowed.

        Args:
            exps: An experience for each seed, as for :meth:`learn`; the same one where only the first maps differ.
            hands: A hand image to learn from for each seed, (trial, time, axis) [m on the screen].
            seeds: Of everything random, one each.
            **settings: Of :meth:`learn`, the same for all.

        Returns:
            What :meth:`learn` gives for each, in their order.

        Raises:
            InvalidConfig: Unequal numbers of experiences, hands and seeds; and as :meth:`learn`.
            InvalidRecording: As :meth:`learn`.
        """
        if not len(exps) == len(hands) == len(seeds):
            raise InvalidConfig(f"{len(exps)} experiences, {len(hands)} hands and {len(seeds)} seeds; give one each")

        def one(given: tuple[Any, Any, int]) -> BodyImage:
            exp, hand, seed = given
            return cls.learn(exp, hand, seed=seed, **settings)

        return list(in_threads(one, list(zip(exps, hands, seeds, strict=True))))


def _snapshots(snapshots: Any, steps: int) -> tuple[int, ...]:
    given = {whole("snapshots", step, 0) for step in snapshots}
    return tuple(sorted({step for step in given if step < steps} | {steps}))


def _rates(
    alpha: str, progress: Float[np.ndarray, " steps"], winners: Int[np.ndarray, " steps"]
) -> Float[np.ndarray, " steps"]:
    """Learning rate at each step."""
    if alpha == "geometric":
        return _ALPHA_START * (_ALPHA_END / _ALPHA_START) ** progress
    rates = np.full(len(winners), _ALPHA_CONSTANT)
    if alpha == "per_visit":
        for unit in np.unique(winners[winners >= 0]):
            visits = winners == unit
            rates[visits] = 1.0 / np.arange(1, visits.sum() + 1)
    return rates


def _learn_map(
    initial: Float[np.ndarray, "rows columns m"],
    winners: Int[np.ndarray, " steps"],
    targets: Float[np.ndarray, "steps m"],
    rates: Float[np.ndarray, " steps"],
    gammas: Float[np.ndarray, " steps"],
    table: Float[np.ndarray, "row_offsets column_offsets"],
    speaking: Bool[np.ndarray, "steps rows columns"] | None,
    snapshots: tuple[int, ...],
) -> Float[np.ndarray, "snapshots rows columns m"]:
    """Every snapshot of a map that learns online, the winner being given (-1: the step teaches nothing).

    ``table`` holds the kernel's exponents over grid offsets at gamma = 1; units not ``speaking`` do not learn.
    """
    # The coordinates come first: the kernel runs over contiguous memory.
    weights = np.ascontiguousarray(np.moveaxis(initial, -1, 0))
    history = np.empty((len(snapshots), *initial.shape))
    everybody = np.empty((0, *initial.shape[:2]), dtype=bool)
    learn(
        weights, winners, targets, rates, gammas, table, np.empty_like(table), np.empty(initial.shape[1]),
        everybody if speaking is None else speaking, np.array(snapshots), history,
    )  # fmt: skip
    return history


def _learn_on_skin(
    initial: Float[np.ndarray, "taxels m"],
    active: Int[np.ndarray, "steps contacts"],
    strengths: Float[np.ndarray, "steps contacts"],
    targets: Float[np.ndarray, "steps m"],
    rates: Float[np.ndarray, " steps"],
    gammas: Float[np.ndarray, " steps"],
    exponents: Float[np.ndarray, "taxels taxels"],
    speaking: Bool[np.ndarray, "steps taxels"] | None,
    snapshots: tuple[int, ...],
) -> Float[np.ndarray, "snapshots taxels m"]:
    """Every snapshot of a map over any skin, by distances between its taxels."""
    weights = np.ascontiguousarray(initial.T)
    history = np.empty((len(snapshots), *initial.shape))
    everybody = np.empty((0, len(initial)), dtype=bool)
    learn_by_distance(
        weights, active, strengths, targets, rates, gammas, exponents, np.empty(len(initial)),
        everybody if speaking is None else speaking, np.array(snapshots), history,
    )  # fmt: skip
    return history
