"""Recordings made by simulation: a body, a motion, and how the arm follows.

Each trial has its own random streams, spawned from the seed: path, rest posture and each kind of noise. Turning one
kind of noise on changes nothing else, and a trial is the same however many there are.

Every motion comes without dynamics (the joints follow the hand with the least displacement) and with: an external force
drags the hand, the arm follows passively.
"""

from __future__ import annotations

import dataclasses
import json
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
import xarray as xr
from jaxtyping import Bool, Float, Int

from bodyimage_kin import _checks
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import DataWarning, InvalidConfig, Unreachable
from bodyimage_kin.recordings.contacts import find_contacts, touched_taxels
from bodyimage_kin.recordings.kinematic import follow
from bodyimage_kin.recordings.motions import Motion, written
from bodyimage_kin.recordings.paths import Path
from bodyimage_kin.recordings.schema import assemble, joint_units
from bodyimage_kin.recordings.settings import Drag, Noise

__all__ = ["Stream", "simulate", "simulate_many"]

Stream = Sequence[np.random.SeedSequence]
"""Of one trial: for its path, rest posture, encoder noise, image noise, silence and torque noise."""
_MOST_TRIALS = 10**5
_MOST_VIEWED = 512
"""Samples of a path at which the eye is tried before the arm is dragged along it."""


def simulate(
    body: Embodiment,
    motion: Motion,
    seed: int = 0,
    trials: int = 1,
    dynamics: bool | Drag = True,
    noise: Noise | None = None,
    *,
    touch_seen: bool = True,
) -> xr.Dataset:
    """Records what a body feels while its hand moves, beside the truth.

    Args:
        body: The embodiment.
        motion: What the hand does, such as ``bk.motions.Circle()``.
        seed: Same seed, same bits.
        trials: Number of trials; each draws its own path and rest posture.
        dynamics: A force drags the hand and the arm follows passively, on request with settings of the drag; False:
            kinematic motion with the least joint displacement.
        noise: What disturbs the arm and what it feels; None: nothing.
        touch_seen: Whether images of the hand while it touches count as seen, where the eye sees it then: one that
            stands in the world does, the paper's does not.

    Returns:
        A recording; the module :mod:`bodyimage_kin.recordings.schema` says what is in it.

    Raises:
        InvalidConfig: A setting out of range, or an embodiment whose eye sees nothing of a motion in its view; of one
            that sees a part of it, or the hand while it touches, a DataWarning tells.
        NoSkin: A motion on the skin of a body that has none.
        InvalidURDF: With dynamics, a robot without masses.
        Unreachable: The hand cannot follow within the joint limits.
        UnknownName: A landmark that the skin does not have.
    """
    return simulate_many(body, motion, [seed], trials, dynamics, noise, touch_seen=touch_seen)[0]


def simulate_many(
    body: Embodiment,
    motion: Motion,
    seeds: Sequence[int],
    trials: int = 1,
    dynamics: bool | Drag = True,
    noise: Noise | None = None,
    threads: int | None = None,
    *,
    touch_seen: bool = True,
) -> list[xr.Dataset]:
    """Several recordings of one motion, simulated together: the same, bit by bit, as one at a time.

    Args:
        body: As of :func:`simulate`.
        motion: As of :func:`simulate`.
        seeds: One for each recording.
        trials: As of :func:`simulate`.
        dynamics: As of :func:`simulate`.
        noise: As of :func:`simulate`.
        threads: With dynamics, at most this many; None: as many as there are processors. No bit depends on it.
        touch_seen: As of :func:`simulate`.

    Returns:
        One recording for each seed.

    Raises:
        InvalidConfig: Less than one thread; and as :func:`simulate`.
    """
    asked = _Asked.of(body, motion, trials, dynamics, noise, touch_seen)
    if threads is not None:
        _checks.whole("threads", threads, least=1)
    seeds = [_checks.whole("seed", seed, least=0) for seed in seeds]
    streams = [[trial.spawn(6) for trial in np.random.SeedSequence(seed).spawn(asked.trials)] for seed in seeds]
    flat = [stream for trials in streams for stream in trials]
    moved = _lead(asked, flat) if asked.drag is None else _drag(asked, asked.drag, flat, threads)
    _say(asked, moved)
    each = iter(moved)
    return [
        _note(asked, seed, trials, [next(each) for _ in trials]) for seed, trials in zip(seeds, streams, strict=True)
    ]


@dataclass(frozen=True, eq=False)
class _Asked:
    """What all recordings of a call share, checked; ``drag`` is None without dynamics."""

    body: Embodiment
    motion: Motion
    trials: int
    drag: Drag | None
    noise: Noise
    touch_seen: bool

    @classmethod
    def of(
        cls,
        body: Embodiment,
        motion: Motion,
        trials: int,
        dynamics: bool | Drag,
        noise: Noise | None,
        touch_seen: bool,
    ) -> _Asked:
        if not isinstance(body, Embodiment):
            raise InvalidConfig(f"body is {type(body).__name__}; give an embodiment: bk.load_embodiment(...)")
        written(motion)
        _checks.number("silence", motion.silence, least=0.0, most=1.0)
        if not isinstance(dynamics, Drag):
            dynamics = _checks.flag("dynamics", dynamics)
        if noise is not None and not isinstance(noise, Noise):
            raise InvalidConfig(f"noise is {type(noise).__name__}; give bk.Noise(...) or None")
        found = noise or Noise()
        if found.torque and dynamics is False:
            raise InvalidConfig(
                f"noise: torque={found.torque:g} disturbs an arm that is dragged; use dynamics=True or torque=0"
            )
        drag = dynamics if isinstance(dynamics, Drag) else Drag() if dynamics else None
        count = _checks.whole("trials", trials, least=1, most=_MOST_TRIALS)
        asked = cls(body, motion, count, drag, found, _checks.flag("touch_seen", touch_seen))
        # What cannot be told later is refused before it is simulated.
        asked.config(0)
        return asked

    def config(self, seed: int) -> str:
        """Everything a recording was asked for, as JSON."""
        values = {
            "motion": written(self.motion),
            "dynamics": False if self.drag is None else dataclasses.asdict(self.drag),
            "noise": dataclasses.asdict(self.noise),
            "seed": seed,
            "trials": self.trials,
            **({} if self.touch_seen else {"touch_seen": False}),
        }
        try:
            return json.dumps(values, sort_keys=True)
        except (TypeError, ValueError) as problem:
            raise InvalidConfig(
                f"motion {type(self.motion).__name__} has a setting that is no plain value: {problem}"
            ) from None


@dataclass(frozen=True, eq=False)
class _Moved:
    """One trial: how the body moved, and what follows from that alone."""

    q: Float[np.ndarray, "time p"]
    at_reference: Bool[np.ndarray, "time"]
    visible: Bool[np.ndarray, "time"]
    taxel: Int[np.ndarray, "time"]


def _path(asked: _Asked, stream: Stream, sampling: float) -> Path:
    """The path of one trial."""
    path = asked.motion.path(asked.body, np.random.default_rng(stream[0]), sampling)
    if not isinstance(path, Path):
        raise InvalidConfig(f"motion {type(asked.motion).__name__}: its path is {type(path).__name__}, not a Path")
    return path


def _rest(asked: _Asked, stream: Stream) -> Float[np.ndarray, "p"]:
    """The rest posture of one trial."""
    body = asked.body
    spread = asked.motion.rest_spread * np.random.default_rng(stream[1]).uniform(-1.0, 1.0, body.p)
    lower, upper = body.felt_robot.lower.numpy(), body.felt_robot.upper.numpy()
    return np.clip(body.felt_home.numpy() + spread, lower, upper)


def _lead(asked: _Asked, streams: Sequence[Stream]) -> list[_Moved]:
    """Trials without dynamics, one after the other."""
    body, motion = asked.body, asked.motion
    pull = 1.0 - np.exp(-motion.rest_pull * motion.sampling)
    moved = []
    for stream in streams:
        way = _path(asked, stream, motion.sampling)
        q = follow(body, way.centres, _rest(asked, stream), float(pull))
        moved.append(_Moved(q, way.resting, _look(asked, q), _touched(body, q)))
    return moved


def _drag(asked: _Asked, settings: Drag, streams: Sequence[Stream], threads: int | None) -> list[_Moved]:
    """Trials with dynamics, all at once."""
    # MuJoCo is loaded by those alone who drag.
    from bodyimage_kin.recordings import dynamics

    body, motion = asked.body, asked.motion
    every = dynamics.whole_steps(motion.sampling, settings.step, "sampling")
    ways = [_path(asked, stream, settings.step) for stream in streams]
    courses = [
        dynamics.Course(way.centres, _rest(asked, stream), np.random.default_rng(stream[5]), motion.touches)
        for way, stream in zip(ways, streams, strict=True)
    ]
    for way in ways:
        _check_view(asked, way.centres[::every])
    moved = []
    dragged = dynamics.drag(body, courses, settings, asked.noise, sampling=motion.sampling, threads=threads)
    for way, q in zip(ways, dragged, strict=True):
        taxel = _touched(body, q, settings.tolerance)
        moved.append(_Moved(q, way.resting[::every], body.visible(q).numpy(), taxel))
    return moved


def _touched(
    body: Embodiment, q: Float[np.ndarray, "time p"], tolerance: float | None = None
) -> Int[np.ndarray, "time"]:
    """The taxel that each posture touches, -1 where none; by contact with the skin's shapes where one is tolerated."""
    if body.skin is None:
        return np.full(len(q), -1, dtype=np.int64)
    with torch.no_grad():
        in_skin = body.hand_in_skin(torch.from_numpy(q)).numpy()
    if tolerance is None:
        return body.skin.touched(in_skin, body.hand.radius)
    return touched_taxels(body.skin, find_contacts(body.skin, in_skin, body.hand.radius, tolerance))


def _check_view(asked: _Asked, centres: Float[np.ndarray, "time 3"]) -> None:
    """Refuses an embodiment whose eye does not see what it should on the path itself, which no force leaves."""
    tried = centres[:: -(-len(centres) // _MOST_VIEWED)]
    q, reached = asked.body.reach(torch.from_numpy(tried))
    if not bool(reached.all()):
        raise Unreachable(
            f"the hand cannot reach {int((~reached).sum())} of {len(tried)} samples of the path within the joint limits"
        )
    _look(asked, q.numpy())


_PASSED_OVER = 0.1
"""Share of samples that a swinging arm may take out of view, or into it, without a word."""


def _look(asked: _Asked, postures: Float[np.ndarray, "time p"]) -> Bool[np.ndarray, "time"]:
    """Which samples are seen; a motion in view of which nothing is seen is refused."""
    body, motion = asked.body, asked.motion
    visible = body.visible(postures).numpy()
    if motion.in_view and not visible.any():
        raise InvalidConfig(
            f"embodiment '{body.name}': the eye does not see the hand in {len(visible)} of {len(visible)} samples of "
            f"{type(motion).__name__}; move it (distance, radius) or mend the camera"
        )
    return visible


def _say(asked: _Asked, moved: Sequence[_Moved]) -> None:
    """Warns, once a call, of an eye that does not see what the motion shows it, or sees what it is to hide."""
    body, motion = asked.body, asked.motion
    visible = np.concatenate([np.zeros(0, dtype=bool), *(trial.visible for trial in moved)])
    share = visible.mean() if len(visible) else float(motion.in_view)
    if motion.in_view and 1 - share > _PASSED_OVER:
        said = f"does not see the hand in {int((~visible).sum())} of {len(visible)} samples of {type(motion).__name__}"
    elif motion.touches and share > _PASSED_OVER and asked.touch_seen:
        said = (
            f"sees the hand in {int(visible.sum())} of {len(visible)} samples while it touches the skin (of none with "
            "touch_seen=False)"
        )
    else:
        return
    message = f"embodiment '{body.name}': the eye {said}; `bodyimage-kin embodiment check` says why"
    warnings.warn(message, DataWarning, stacklevel=3)


def _note(asked: _Asked, seed: int, streams: Sequence[Stream], moved: Sequence[_Moved]) -> xr.Dataset:
    """The recording of these trials: what is felt and what is true."""
    body, noise, motion = asked.body, asked.noise, asked.motion
    skin, model = body.skin, body.camera.model
    trials, samples = len(moved), max(len(trial.q) for trial in moved)
    q = np.full((trials, samples, body.p), np.nan)
    true_q = q.copy()
    at_reference = np.zeros((trials, samples), dtype=bool)
    true_image, position = np.full((trials, samples, body.m), np.nan), np.full((trials, samples, 3), np.nan)
    image = true_image.copy()
    true_touched = np.full((trials, samples, 1), -1, dtype=np.int64)
    touched = true_touched.copy()
    for trial, (one, stream) in enumerate(zip(moved, streams, strict=True)):
        for_encoders, for_image, for_silence = map(np.random.default_rng, stream[2:5])
        here = slice(0, len(one.q))
        true_q[trial, here] = one.q
        at_reference[trial, here] = one.at_reference
        with torch.no_grad():
            tensor = torch.from_numpy(one.q)
            true_image[trial, here] = body.hand_image(tensor, on_invisible="nan").numpy()
            position[trial, here] = body.hand_position(tensor).numpy()
        true_touched[trial, here, 0] = one.taxel
        q[trial, here] = one.q + noise.encoder * for_encoders.standard_normal(one.q.shape)
        noisy = true_image[trial, here] + noise.image * for_image.standard_normal((len(one.q), body.m))
        seen = one.visible if asked.touch_seen else one.visible & (one.taxel < 0)
        image[trial, here] = np.where(seen[:, None], noisy, np.nan)
        silent = for_silence.random(len(one.q)) < motion.silence
        touched[trial, here, 0] = np.where(silent, -1, one.taxel)
    variables: dict[str, np.ndarray] = {
        "q": q,
        "hand_image": image,
        "true_q": true_q,
        "true_hand_image": true_image,
        "true_hand_position": position,
    }
    if skin is not None:
        with torch.no_grad():
            at_rest = body.hand_image(body.touch_postures([skin.reference]), on_invisible="nan")[0].numpy()
        variables |= {
            "touched": touched,
            "true_touched": true_touched,
            "at_reference": at_reference,
            "reference_image": at_rest,
        }
    return assemble(
        variables,
        joints=body.joints,
        axes=model.names,
        time=np.round(np.arange(samples) * motion.sampling, 9),
        units={"q": joint_units(body), "hand_image": model.unit, "time": "s"},
        attributes={
            "order": "stream",
            "motion": type(motion).__name__,
            "embodiment": body.name,
            "embodiment_sha256": body.sha256,
            "urdf_sha256": body.robot.sha256,
            **({} if skin is None or skin.shape is None else {"rows": skin.shape[0], "columns": skin.shape[1]}),
            "sampling": motion.sampling,
            "encoder_noise": noise.encoder,
            "image_noise": noise.image,
            "config": asked.config(seed),
        },
    )
