"""Laws of motions as specs: what they refuse, what a recording says of them, and motions of one's own."""

import json
import re
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
import scipy.spatial

import bodyimage_kin as bk
from bodyimage_kin.errors import DataWarning, InvalidConfig
from bodyimage_kin.recordings import simulate_many
from bodyimage_kin.recordings.motions import Babbling, Circle, Circles, FaceTour, Motion, Path, RandomTouch


@dataclass(frozen=True)
class Lissajous(Motion):
    """A figure in front of the face; each trial has a phase of its own."""

    size: float = 0.03
    ratio: int = 2
    in_view: ClassVar[bool] = True

    def path(self, body, rng, sampling):
        angle = rng.uniform(0.0, 2 * np.pi) + self.speed / self.size * np.arange(0.0, 4.0, sampling)
        x, y = self.size * np.sin(angle), self.size * np.sin(self.ratio * angle)
        centre = body.touch_centres([body.skin.count // 2], 0.03)[0].numpy()
        return Path(centre + x[:, None] * body.skin.right + y[:, None] * body.skin.down)


@dataclass(frozen=True)
class Resting(Motion):
    """The hand stays at the reference and touches it, sometimes in silence."""

    silence: float = 0.25
    touches: ClassVar[bool] = True

    def path(self, body, rng, sampling):
        place = body.touch_centres([body.skin.reference]).numpy()
        return Path(np.repeat(place, round(20.0 / sampling), axis=0))


@dataclass(frozen=True)
class Pathless(Motion):
    found: object = None

    def path(self, body, rng, sampling):
        return self.found


# Specs ---------------------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    ("spec", "settings", "message"),
    [
        (Circle, {"radius": 0.0}, "Circle: radius=0.0: give a number above 0"),
        (Circle, {"radius": "5cm"}, "Circle: radius='5cm': give a number above 0"),
        (Circle, {"turns": -1}, "Circle: turns=-1: give"),
        (Circle, {"turns": True}, "Circle: turns=True: give"),
        (Circle, {"speed": float("nan")}, "Circle: speed=nan"),
        (Circle, {"sampling": 0}, "Circle: sampling=0: give a number above 0"),
        (Circle, {"sampling": float("inf")}, "Circle: sampling=inf"),
        (Circle, {"distance": -0.1}, "Circle: distance=-0.1: give a number of at least 0"),
        (Circle, {"rest_spread": -0.1}, "Circle: rest_spread=-0.1"),
        (Circle, {"rest_pull": None}, "Circle: rest_pull=None"),
        (Circles, {"distances": ()}, "Circles: distances=(): give one distance or more"),
        (Circles, {"distances": 0.03}, "Circles: distances=0.03: give a list of numbers"),
        (Circles, {"distances": [0.03, -0.1]}, "Circles: distances[1]=-0.1: give a number of at least 0"),
        (Circles, {"radii": (0.05, 0.0, 0.05)}, "Circles: radii[1]=0.0: give a number above 0"),
        (Circles, {"radii": (0.05, 0.04)}, "Circles: radii=(0.05, 0.04): give one for all, or 3, one a distance"),
        (Circles, {"turns": 0}, "Circles: turns=0: give a number above 0"),
        (bk.motions.Lissajous, {"rates": (3, 2)}, "Lissajous: rates=(3, 2): give three whole numbers"),
        (bk.motions.Lissajous, {"rates": (3, 2, 0.5)}, "Lissajous: rates[2]=0.5: give a whole number of at least 1"),
        (bk.motions.Lissajous, {"depth": 0.1}, "Lissajous: depth=0.1: give a number of at least 0 and at most 0.06"),
        (bk.motions.Lissajous, {"width": 0.0}, "Lissajous: width=0.0"),
        (Babbling, {"farthest": 0.01}, "Babbling: farthest=0.01: give a number of at least 0.02"),
        (Babbling, {"duration": -1}, "Babbling: duration=-1"),
        (FaceTour, {"landmarks": ["nose"]}, "FaceTour: landmarks=['nose']: give two landmarks or more"),
        (FaceTour, {"landmarks": "nose"}, "FaceTour: landmarks='nose': give names of landmarks in a list"),
        (FaceTour, {"landmarks": [1, 2]}, "FaceTour: landmarks=[1, 2]"),
        (FaceTour, {"landmarks": 3}, "FaceTour: landmarks=3: give names of landmarks in a list"),
        (FaceTour, {"speed": 0.0}, "FaceTour: speed=0.0"),
        (FaceTour, {"silence": -0.1}, "FaceTour: silence=-0.1"),
        (RandomTouch, {"silence": 1.5}, "RandomTouch: silence=1.5: give a number of at least 0 and at most 1"),
        (RandomTouch, {"duration": None}, "RandomTouch: duration=None"),
        (RandomTouch, {"reset_interval": 0.0}, "RandomTouch: reset_interval=0.0"),
        (RandomTouch, {"rest": 0.0}, "RandomTouch: rest=0.0"),
        (bk.Noise, {"encoder": -1}, "noise: encoder=-1: give a number of at least 0"),
        (bk.Noise, {"image": float("nan")}, "noise: image=nan"),
        (bk.Noise, {"torque": "0.1"}, "noise: torque='0.1'"),
        (bk.Noise, {"torque_hold": 0.0}, "noise: torque_hold=0.0: give a number above 0"),
        (bk.Drag, {"stiffness": 0.0}, "drag: stiffness=0.0: give a number above 0"),
        (Circle, {"turns": 1e308}, "has more than 1000000 samples; give fewer turns or a smaller radius"),
        (Circle, {"radius": 1e9}, "has more than 1000000 samples"),
        (Circle, {"sampling": 1e-300}, "has more than 1000000 samples"),
        (Circle, {"speed": 1e-300, "radius": 1e300}, "a trial of inf s"),
        (RandomTouch, {"duration": 1e12}, "has more than 1000000 samples; give a shorter duration"),
        (bk.Drag, {"step": 0.0}, "drag: step=0.0"),
        (bk.Drag, {"damping": -1.0}, "drag: damping=-1.0: give a number of at least 0"),
    ],
)
def test_a_setting_out_of_range_is_named_with_the_remedy(spec, settings, message):
    with pytest.raises(InvalidConfig, match=re.escape(message)):
        spec(**settings)


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"motion": Circle}, "motion is Circle (the class); give a motion, such as bk.motions.Circle()"),
        ({"motion": "circle"}, "motion is str; give a motion"),
        ({"body": "infant"}, "body is str; give an embodiment"),
        ({"trials": 0}, "trials=0: give a whole number of at least 1"),
        ({"trials": 2.0}, "trials=2.0"),
        ({"trials": 10**12}, "trials=1000000000000: give a whole number of at least 1 and at most 100000"),
        ({"motion": bk.motions.FaceTour(speed=1e-9)}, "has more than 1000000 samples; give a higher speed"),
        ({"seed": -1}, "seed=-1"),
        ({"dynamics": 1}, "dynamics=1: give true or false"),
        ({"noise": 0.1}, "noise is float; give bk.Noise(...) or None"),
        ({"dynamics": False, "noise": bk.Noise(torque=0.1)}, "noise: torque=0.1 disturbs an arm that is dragged"),
        ({"motion": Pathless()}, "motion Pathless: its path is NoneType, not a Path"),
        ({"motion": Pathless(np.zeros(3))}, "setting that is no plain value"),
    ],
)
def test_a_question_that_makes_no_sense_is_refused(body, arguments, message):
    asked = {"body": body, "motion": Circle(turns=0.1), "dynamics": False, **arguments}
    with pytest.raises(InvalidConfig, match=re.escape(message)):
        bk.simulate(**asked)


def test_threads_are_counted(body):
    with pytest.raises(InvalidConfig, match="threads=0: give a whole number of at least 1"):
        simulate_many(body, Circle(), [0], threads=0)


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("centres", [np.zeros((0, 3)), np.zeros((4, 2)), np.zeros(3), [[np.nan, 0.0, 0.0]]])
def test_a_path_is_finite_places(centres):
    with pytest.raises(InvalidConfig, match="path: centres have shape"):
        Path(np.asarray(centres))
    with pytest.raises(InvalidConfig, match="at_reference has shape"):
        Path(np.zeros((3, 3)), np.zeros(2, dtype=bool))


@pytest.mark.usefixtures("unchecked")
def test_whole_numbers_are_numbers():
    assert Circle(turns=3) == Circle(turns=3.0)
    assert type(Circle(turns=np.int64(3)).turns) is float
    assert FaceTour(["nose", "mouth"]) == FaceTour(("nose", "mouth"))
    assert bk.Noise(torque=np.float32(0.5)).torque == 0.5


# What a recording says of its motion ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "motion",
    [
        Circle(turns=0.1, speed=0.06, sampling=0.05),
        FaceTour(("nose", "mouth"), silence=0.5, rest_spread=0.0),
        RandomTouch(1.0, reset_interval=None, rest=0.2),
        Circles((0.03, 0.06), (0.02, 0.03), turns=0.1),
        bk.motions.Lissajous(duration=1.0, rates=(3, 2, 2)),
        Babbling(duration=1.0),
    ],
)
def test_a_motion_can_be_read_back_from_its_recording(body, motion):
    noise = bk.Noise(encoder=1e-3, image=2e-4)
    recording = bk.simulate(body, motion, seed=7, trials=2, dynamics=False, noise=noise)
    config = json.loads(recording.attrs["config"])
    [(name, fields)] = config["motion"].items()
    assert name == recording.attrs["motion"]
    assert getattr(bk.motions, name)(**fields) == motion
    assert bk.Noise(**config["noise"]) == noise
    assert (config["dynamics"], config["seed"], config["trials"]) == (False, 7, 2)


def test_the_noise_is_stated_each_kind_by_its_name(body):
    recording = bk.simulate(body, Circle(turns=0.1), dynamics=False, noise=bk.Noise(encoder=1e-3, image=2e-4))
    assert (recording.attrs["encoder_noise"], recording.attrs["image_noise"]) == (1e-3, 2e-4)
    quiet = bk.simulate(body, Circle(turns=0.1), dynamics=False)
    assert (quiet.attrs["encoder_noise"], quiet.attrs["image_noise"]) == (0.0, 0.0)


def test_the_settings_of_the_drag_are_kept(body):
    drag = bk.Drag(stiffness=80.0, friction=0.1)
    recording = bk.simulate(body, Circle(turns=0.1), dynamics=drag, noise=bk.Noise(torque=0.1))
    config = json.loads(recording.attrs["config"])
    assert bk.Drag(**config["dynamics"]) == drag
    assert bk.Noise(**config["noise"]) == bk.Noise(torque=0.1)


# Motions in view -----------------------------------------------------------------------------------------------------


def told(body, motion, sampling=0.01, seed=0):
    """The path of the hand: to the right, down, and ahead of where the middle taxel is touched [m]."""
    frame = body.circle_frame(0.0)
    centres = motion.path(body, np.random.default_rng(seed), sampling).centres
    return (centres - frame.origin) @ np.stack([frame.right, frame.down, frame.forward]).T


def test_circles_at_one_distance_are_the_circle(body):
    several, one = Circles((0.04,), (0.03,), turns=1.5), Circle(0.03, 0.04, turns=1.5)
    assert several.duration == pytest.approx(one.duration, rel=1e-12)
    np.testing.assert_allclose(told(body, several), told(body, one), atol=1e-12)


def test_every_circle_is_drawn_both_ways_at_one_speed(body):
    motion = Circles((0.02, 0.05, 0.1), (0.05, 0.03, 0.05), turns=1.0, speed=0.04)
    x, y, ahead = told(body, motion).T
    radius, steps = np.hypot(x, y), np.linalg.norm(np.diff([x, y, ahead]), axis=0)
    for distance, wide in zip(motion.distances, motion.radii, strict=True):
        on = (abs(ahead - distance) < 1e-9) & (abs(radius - wide) < 1e-9)
        # One turn each way, each as long as its circumference takes.
        assert on.sum() * 0.01 == pytest.approx(2 * 2 * np.pi * wide / 0.04, abs=0.05)
        angle = np.unwrap(np.arctan2(y[on], x[on]))
        half = len(angle) // 2
        assert angle[half] - angle[0] == pytest.approx(2 * np.pi, abs=0.05)
        assert angle[-1] - angle[0] == pytest.approx(0.0, abs=0.05)
    # Chords are shorter than arcs; between two circles there are two corners, and once the way turns back.
    assert steps.max() <= 0.04 * 0.01 * (1 + 1e-9)
    assert np.sort(steps)[2 * 4 + 1] > 0.04 * 0.01 * (1 - 1e-2)
    assert len(x) == int(motion.duration / 0.01 + 1e-9) + 1
    there, back = np.array([x, y, ahead])[:, : len(x) // 2], np.array([x, y, ahead])[:, ::-1][:, : len(x) // 2]
    assert abs(there - back).max() < 0.04 * 0.01


def test_three_circles_take_as_long_as_three_turns_and_the_ways_between():
    assert Circles().duration == pytest.approx(Circle().duration + 2 * 0.08 / 0.05, rel=1e-12)


def test_a_lissajous_figure_fills_its_box_at_constant_speed(body):
    motion = bk.motions.Lissajous(distance=0.06, width=0.05, height=0.03, depth=0.02, duration=300.0)
    x, y, ahead = told(body, motion).T
    for values, middle, half in ((x, 0.0, 0.05), (y, 0.0, 0.03), (ahead, 0.06, 0.02)):
        assert values.min() == pytest.approx(middle - half, abs=1e-6)
        assert values.max() == pytest.approx(middle + half, abs=1e-6)
    steps = np.linalg.norm(np.diff([x, y, ahead]), axis=0) / (0.05 * 0.01)
    # Chords are shorter than arcs, where it bends most by a seventh; it never turns back on itself.
    assert steps.max() <= 1 + 1e-9
    assert np.quantile(steps, 0.01) > 0.99
    assert steps.min() > 0.8
    # Each coordinate swings so often: crossings of the middle in the time of one round.
    length = bk.recordings.paths.lengths(np.stack([x, y, ahead], 1))
    again = np.flatnonzero(np.linalg.norm(np.stack([x, y, ahead], 1) - [x[0], y[0], ahead[0]], axis=1) < 3e-4)
    once = again[length[again] > 0.01][0]
    crossings = [int((np.diff(np.sign(values[: once + 1])) != 0).sum()) for values in (x, y, ahead - 0.06)]
    assert crossings == [10, 8, 6]
    assert not np.allclose(x[0], told(body, motion, seed=1)[0, 0])


def test_babbling_goes_straight_from_place_to_place_and_fills_its_cylinder(body):
    motion = Babbling(0.03, 0.09, 0.04, duration=2000.0)
    x, y, ahead = told(body, motion, sampling=0.1).T
    assert np.hypot(x, y).max() <= 0.04 + 1e-9
    assert 0.03 - 1e-9 <= ahead.min() < 0.031
    assert 0.089 < ahead.max() <= 0.09 + 1e-9
    steps = np.diff([x, y, ahead])
    size = np.linalg.norm(steps, axis=0)
    assert size.max() <= 0.05 * 0.1 * (1 + 1e-9)
    # Straight: most steps are as long as the way, and point where the last one did.
    assert np.median(size) == pytest.approx(0.05 * 0.1, rel=1e-9)
    assert ((steps[:, 1:] * steps[:, :-1]).sum(0) > (1 - 1e-9) * (0.05 * 0.1) ** 2).mean() > 0.5
    assert len(x) == 20000


@pytest.mark.parametrize("motion", [Circles(turns=0.1), bk.motions.Lissajous(duration=5.0), Babbling(duration=5.0)])
def test_motions_in_view_are_seen_and_learned_from(body, motion):
    for dynamics in (False, True):
        recording = bk.simulate(body, motion, seed=1, dynamics=dynamics)
        assert np.isfinite(recording.hand_image).mean() > 0.95
        bk.estimators.LeastSquares().fit(bk.experience(recording))


# A motion of one's own -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("dynamics", "apart"), [(False, 1e-5), (True, 8e-3)])
def test_a_figure_of_ones_own_is_drawn_in_view_and_learned_from(body, dynamics, apart):
    recording = bk.simulate(body, Lissajous(size=0.02), seed=1, trials=2, dynamics=dynamics)
    assert np.isfinite(recording.hand_image).all()
    assert not recording.at_reference.any()
    angle = np.linspace(0.0, 2 * np.pi, 20000)[:, None]
    figure = 0.02 * (np.sin(angle) * body.skin.right + np.sin(2 * angle) * body.skin.down)
    figure += body.touch_centres([body.skin.count // 2], 0.03)[0].numpy()
    for trial in range(2):
        hand = body.hand_in_skin(recording.true_q.values[trial]).numpy()
        assert scipy.spatial.KDTree(figure).query(hand)[0].max() < apart
    assert not np.allclose(recording.true_q[0, 0], recording.true_q[1, 0])
    bk.estimators.LeastSquares().fit(bk.experience(recording))
    [(name, fields)] = json.loads(recording.attrs["config"])["motion"].items()
    assert name == f"{__name__}:Lissajous"
    assert Lissajous(**fields) == Lissajous(size=0.02)


@pytest.mark.parametrize("dynamics", [False, True])
def test_a_touch_of_ones_own_is_felt_and_may_be_silent(body, dynamics):
    recording = bk.simulate(body, Resting(), seed=1, dynamics=dynamics)
    assert (recording.true_touched == body.skin.reference).mean() > 0.95
    silent = (recording.touched == -1) & (recording.true_touched >= 0)
    assert 0.1 < silent.mean() < 0.4
    assert np.isnan(recording.hand_image).all()


def test_what_a_class_demands_is_demanded(body):
    @dataclass(frozen=True)
    class Unseen(Lissajous):
        in_view: ClassVar[bool] = False
        touches: ClassVar[bool] = True

    for dynamics in (False, True):
        with pytest.warns(DataWarning, match=r"the eye sees the hand in .* samples while it touches"):
            bk.simulate(body, Unseen(), dynamics=dynamics)


def test_a_motion_that_is_no_dataclass_is_refused(body):
    class Forgotten(Lissajous):
        pass

    with pytest.raises(InvalidConfig, match=re.escape("motion Forgotten is no dataclass; write @dataclass(frozen")):
        bk.simulate(body, Forgotten())
