"""Recordings made by simulation: the circle in view, the tour of the face, touches at random.

Each trial has its own random streams, spawned from the seed: path, rest posture and each kind of noise. Turning one
kind of noise on changes nothing else, and a trial is the same however many there are.

Every motion comes without dynamics (the joints follow the hand with the least displacement) and with: an external force
drags the hand, the arm follows passively (:mod:`bodyimage_kin.recordings.dynamics`).
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
import xarray as xr
from jaxtyping import Bool, Float, Int

from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidConfig, UnknownName, Unreachable
from bodyimage_kin.recordings import paths
from bodyimage_kin.recordings.contacts import find_contacts, touched_taxels
from bodyimage_kin.recordings.dynamics import DragSettings as DragSettings
from bodyimage_kin.recordings.dynamics import Motion, drag, whole_steps
from bodyimage_kin.recordings.kinematic import follow
from bodyimage_kin.recordings.schema import make_recording

Stream = Sequence[np.random.SeedSequence]
"""Of one trial: for its path, rest posture, encoder noise, image noise, silence and torque noise."""
TOUR = ("mouth", "nose", "right_eye", "left_eye", "nose")
"""The paper's sequence of landmarks (section 4.1)."""


def circle(
    body: Embodiment,
    trials: int = 1,
    seed: int = 0,
    dynamics: bool = True,
    *,
    radius: float = 0.05,
    distance: float = 0.03,
    turns: float = 3.0,
    speed: float = 0.05,
    sampling: float = 0.1,
    rest_spread: float = 0.1,
    rest_pull: float = 0.5,
    encoder_noise: float = 0.0,
    image_noise: float = 0.0,
    drag: DragSettings | None = None,
) -> xr.Dataset:
    """The hand draws circles in front of the face, both ways, in view: what a Jacobian is learned from (Fig. 7).

    Args:
        body: The embodiment.
        trials: Number of trials; each has its own phase and rest posture.
        seed: Same seed, same bits.
        dynamics: A force drags the hand and the arm follows passively; False: kinematic motion with the least joint
            displacement.
        radius: Of the circle [m].
        distance: From touching, along the face's forward direction [m].
        turns: Each way.
        speed: Of the hand [m/s].
        sampling: Time between samples [s].
        rest_spread: Each trial's rest posture is home plus a uniform draw of this half width a joint [rad].
        rest_pull: Rate at which joints return to rest where the hand leaves them free [1/s]; without dynamics.
        encoder_noise: Standard deviation of the noise on felt joint values [rad].
        image_noise: Standard deviation of the noise on the felt hand image [m].
        drag: How the hand is dragged and what torque disturbs it, with dynamics; None: the defaults.

    Returns:
        A recording; the module :mod:`bodyimage_kin.recordings.schema` says what is in it.

    Raises:
        InvalidConfig: A setting out of range, or an embodiment whose eye does not see the whole circle.
        InvalidURDF: With dynamics, a robot without masses.
        Unreachable: The hand cannot follow within the joint limits.
    """
    return _record(body, [_config("circle", locals())])[0]


def face_tour(
    body: Embodiment,
    trials: int = 1,
    seed: int = 0,
    dynamics: bool = True,
    *,
    landmarks: Sequence[str] = TOUR,
    speed: float = 0.05,
    sampling: float = 0.1,
    rest_spread: float = 0.1,
    rest_pull: float = 0.5,
    silence: float = 0.0,
    encoder_noise: float = 0.0,
    image_noise: float = 0.0,
    drag: DragSettings | None = None,
) -> xr.Dataset:
    """The hand visits landmarks of the face, touching it: where velocities are compared (Figs. 8 and 9).

    Args:
        body: The embodiment.
        trials: Number of trials; each has its own rest posture.
        seed: Same seed, same bits.
        dynamics: As in :func:`circle`.
        landmarks: Names of landmarks of the skin, in order.
        speed: Mean speed of the hand between two landmarks [m/s].
        sampling: Time between samples [s].
        rest_spread: As in :func:`circle` [rad].
        rest_pull: As in :func:`circle` [1/s].
        silence: Probability that a touch is not reported.
        encoder_noise: As in :func:`circle` [rad].
        image_noise: As in :func:`circle` [m].
        drag: As in :func:`circle`; the hand is pressed on the skin.

    Raises:
        UnknownName: A landmark that the skin does not have.
        InvalidConfig: As in :func:`circle`, or an eye that sees the hand touch.
        Unreachable: As in :func:`circle`.
    """
    return _record(body, [_config("face_tour", locals())])[0]


def random_touch(
    body: Embodiment,
    trials: int = 1,
    seed: int = 0,
    dynamics: bool = True,
    *,
    duration: float = 800.0,
    speed: float = 0.05,
    reset_interval: float | None = 10.0,
    rest: float = 0.5,
    sampling: float = 0.1,
    rest_spread: float = 0.1,
    rest_pull: float = 0.5,
    silence: float = 0.2,
    encoder_noise: float = 0.0,
    image_noise: float = 0.0,
    drag: DragSettings | None = None,
) -> xr.Dataset:
    """The hand touches the face at random and returns to the reference from time to time: what maps are learned from.

    Args:
        body: The embodiment.
        trials: Number of trials; each has its own targets and rest posture.
        seed: Same seed, same bits.
        dynamics: As in :func:`circle`.
        duration: [s].
        speed: Of the hand [m/s].
        reset_interval: Time between returns to the reference [s]; None: it never returns.
        rest: How long the hand rests at the reference [s].
        sampling: Time between samples [s].
        rest_spread: As in :func:`circle` [rad].
        rest_pull: As in :func:`circle` [1/s].
        silence: Probability that a touch is not reported (0.2 in the paper).
        encoder_noise: As in :func:`circle` [rad].
        image_noise: As in :func:`circle` [m].
        drag: As in :func:`circle`; the hand is pressed on the skin.

    Raises:
        InvalidConfig: As in :func:`face_tour`.
        Unreachable: As in :func:`circle`.
    """
    return _record(body, [_config("random_touch", locals())])[0]


_MOTIONS: Mapping[str, Callable[..., xr.Dataset]] = {
    "circle": circle,
    "face_tour": face_tour,
    "random_touch": random_touch,
}


def many(
    kind: str, body: Embodiment, seeds: Sequence[int], *, threads: int | None = None, **settings: Any
) -> list[xr.Dataset]:
    """Several recordings of one kind, simulated together: the same, bit by bit, as one at a time.

    Args:
        kind: ``"circle"``, ``"face_tour"`` or ``"random_touch"``.
        body: The embodiment.
        seeds: One for each recording.
        threads: With dynamics, at most this many; None: as many as there are processors. No bit depends on it.
        settings: Of the function of that name.

    Returns:
        One recording for each seed.

    Raises:
        UnknownName: Another kind.
        InvalidConfig: Less than one thread, or a setting that the motion does not have; and as its own function.
    """
    if kind not in _MOTIONS:
        raise UnknownName("kind of recording", kind, _MOTIONS)
    if threads is not None and threads < 1:
        raise InvalidConfig(f"threads={threads!r}: give a whole number of at least 1, or None")
    try:
        asked = [inspect.signature(_MOTIONS[kind]).bind(body, seed=seed, **settings) for seed in seeds]
    except TypeError as problem:
        raise InvalidConfig(f"{kind}: {problem}") from None
    for arguments in asked:
        arguments.apply_defaults()
    return _record(body, [_config(kind, arguments.arguments) for arguments in asked], threads)


def _config(kind: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """What the caller asked for, checked, to be kept with the recording."""
    config: dict[str, Any] = {"kind": kind}
    config |= {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}
    del config["body"]
    if config["dynamics"]:
        config["drag"] = dataclasses.asdict(config["drag"] or DragSettings())
    elif config.pop("drag") is not None:
        raise InvalidConfig("drag: these settings are of the dynamics; use dynamics=True with them")
    _check(config)
    return config


def _check(config: Mapping[str, Any]) -> None:
    if not isinstance(config["trials"], int) or config["trials"] < 1:
        raise InvalidConfig(f"trials={config['trials']!r}: give a whole number of at least 1")
    for field in ("radius", "turns", "speed", "sampling", "duration", "rest", "reset_interval"):
        value = config.get(field)
        if value is not None and not (np.isfinite(value) and value > 0):
            raise InvalidConfig(f"{field}={value!r}: give a positive number")
    for field in ("rest_spread", "rest_pull", "encoder_noise", "image_noise", "silence", "distance"):
        value = config.get(field, 0.0)
        if not (np.isfinite(value) and value >= 0):
            raise InvalidConfig(f"{field}={value!r}: give a number that is not negative")
    if config.get("silence", 0.0) > 1.0:
        raise InvalidConfig(f"silence={config['silence']!r}: give a probability, 0 to 1")


@dataclass(frozen=True, eq=False)
class _Moved:
    """One trial: how the body moved, and what follows from that alone."""

    q: Float[np.ndarray, "time p"]
    at_reference: Bool[np.ndarray, "time"]
    visible: Bool[np.ndarray, "time"]
    taxel: Int[np.ndarray, "time"]


def _record(body: Embodiment, configs: Sequence[Mapping[str, Any]], threads: int | None = None) -> list[xr.Dataset]:
    """One recording for each config, all of one kind: leads the hand along a path a trial, notes what came of it."""
    streams = [
        [trial.spawn(6) for trial in np.random.SeedSequence(config["seed"]).spawn(config["trials"])]
        for config in configs
    ]
    flat = [(config, stream) for config, trials in zip(configs, streams, strict=True) for stream in trials]
    dynamic = bool(configs) and configs[0]["dynamics"]
    moved = iter(_drag(body, flat, threads) if dynamic else [_lead(body, *trial) for trial in flat])
    return [
        _note(body, config, trials, [next(moved) for _ in trials])
        for config, trials in zip(configs, streams, strict=True)
    ]


def _path(body: Embodiment, config: Mapping[str, Any], stream: Stream, sampling: float) -> paths.Path:
    """The path of one trial."""
    rng = np.random.default_rng(stream[0])

    def of(*names: str) -> dict[str, Any]:
        return {name: config[name] for name in names}

    if config["kind"] == "circle":
        return paths.circle(body, rng, sampling=sampling, **of("radius", "distance", "turns", "speed"))
    if config["kind"] == "face_tour":
        return paths.face_tour(body, sampling=sampling, **of("landmarks", "speed"))
    return paths.random_touch(body, rng, sampling=sampling, **of("duration", "speed", "reset_interval", "rest"))


def _rest(body: Embodiment, config: Mapping[str, Any], stream: Stream) -> Float[np.ndarray, "p"]:
    """The rest posture of one trial."""
    spread = config["rest_spread"] * np.random.default_rng(stream[1]).uniform(-1.0, 1.0, body.p)
    lower, upper = body.felt_robot.lower.numpy(), body.felt_robot.upper.numpy()
    return np.clip(body.felt_home.numpy() + spread, lower, upper)


def _lead(body: Embodiment, config: Mapping[str, Any], stream: Stream) -> _Moved:
    """One trial without dynamics."""
    way = _path(body, config, stream, config["sampling"])
    pull = 1.0 - np.exp(-config["rest_pull"] * config["sampling"])
    q = follow(body, way.centres, _rest(body, config, stream), float(pull))
    with torch.no_grad():
        in_skin = body.hand_in_skin(torch.from_numpy(q)).numpy()
    return _Moved(q, way.at_reference, _look(body, config, q), body.require_skin().touched(in_skin, body.hand.radius))


def _drag(body: Embodiment, trials: Sequence[tuple[Mapping[str, Any], Stream]], threads: int | None) -> list[_Moved]:
    """Trials with dynamics, all of one kind and with the same settings but for the seed."""
    config = trials[0][0]
    settings = DragSettings(**config["drag"])
    every = whole_steps(config["sampling"], settings.step, "sampling")
    ways = [_path(body, config, stream, settings.step) for _, stream in trials]
    press = config["kind"] != "circle"
    motions = [
        Motion(way.centres, _rest(body, config, stream), np.random.default_rng(stream[5]), press)
        for way, (_, stream) in zip(ways, trials, strict=True)
    ]
    _check_view(body, config, [way.centres[::every] for way in ways])
    moved = []
    for way, q in zip(ways, drag(body, motions, settings, sampling=config["sampling"], threads=threads), strict=True):
        with torch.no_grad():
            in_skin = body.hand_in_skin(torch.from_numpy(q)).numpy()
        contacts = find_contacts(body.require_skin(), in_skin, body.hand.radius, settings.tolerance)
        taxel = touched_taxels(body.require_skin(), contacts)
        moved.append(_Moved(q, way.at_reference[::every], body.visible(q).numpy(), taxel))
    return moved


def _check_view(body: Embodiment, config: Mapping[str, Any], centres: Sequence[np.ndarray]) -> None:
    """Refuses an embodiment whose eye does not see what it should on the paths themselves, which no force leaves."""
    if config["kind"] == "random_touch":
        _look(body, config, body.touch_postures(np.arange(body.require_skin().count)).numpy())
        return
    for path in centres:
        q, reached = body.reach(torch.from_numpy(path))
        if not bool(reached.all()):
            raise Unreachable(
                f"the hand cannot reach {int((~reached).sum())} of {len(path)} samples of the path within the joint "
                "limits"
            )
        _look(body, config, q.numpy())


def _note(
    body: Embodiment, config: Mapping[str, Any], streams: Sequence[Stream], moved: Sequence[_Moved]
) -> xr.Dataset:
    """The recording of these trials: what is felt and what is true."""
    trials, samples = len(moved), max(len(trial.q) for trial in moved)
    q = np.full((trials, samples, body.p), np.nan)
    true_q = q.copy()
    at_reference = np.zeros((trials, samples), dtype=bool)
    true_image, position = np.full((trials, samples, body.m), np.nan), np.full((trials, samples, 3), np.nan)
    image = true_image.copy()
    true_taxel = np.full((trials, samples), -1, dtype=np.int64)
    taxel = true_taxel.copy()
    for trial, (one, stream) in enumerate(zip(moved, streams, strict=True)):
        for_encoders, for_image, for_silence = map(np.random.default_rng, stream[2:5])
        here = slice(0, len(one.q))
        true_q[trial, here] = one.q
        at_reference[trial, here] = one.at_reference
        with torch.no_grad():
            tensor = torch.from_numpy(one.q)
            true_image[trial, here] = body.hand_image(tensor, on_invisible="nan").numpy()
            position[trial, here] = body.hand_position(tensor).numpy()
        true_taxel[trial, here] = one.taxel
        q[trial, here] = one.q + config["encoder_noise"] * for_encoders.standard_normal(one.q.shape)
        noisy = true_image[trial, here] + config["image_noise"] * for_image.standard_normal((len(one.q), body.m))
        image[trial, here] = np.where(one.visible[:, None], noisy, np.nan)
        silent = for_silence.random(len(one.q)) < config.get("silence", 0.0)
        taxel[trial, here] = np.where(silent, -1, one.taxel)
    with torch.no_grad():
        reference_image = body.hand_image(body.touch_postures([body.require_skin().reference]))[0].numpy()
    return make_recording(
        body,
        q=q,
        hand_image=image,
        taxel=taxel,
        at_reference=at_reference,
        reference_image=reference_image,
        true_q=true_q,
        true_hand_image=true_image,
        true_hand_position=position,
        true_taxel=true_taxel,
        sampling=config["sampling"],
        config=config,
    )


def _look(body: Embodiment, config: Mapping[str, Any], postures: np.ndarray) -> np.ndarray:
    """Which samples are seen: all of a circle and none of a touch, or the embodiment is wrong."""
    visible = body.visible(postures).numpy()
    if config["kind"] == "circle" and not visible.all():
        raise InvalidConfig(
            f"embodiment '{body.name}': the eye does not see the hand in {int((~visible).sum())} of {len(visible)} "
            "samples of the circle; move the circle (distance, radius) or mend camera and skin"
        )
    if config["kind"] != "circle" and visible.any():
        raise InvalidConfig(
            f"embodiment '{body.name}': the eye sees the hand in {int(visible.sum())} of {len(visible)} samples while "
            "it touches the skin; mend camera and skin"
        )
    return visible
