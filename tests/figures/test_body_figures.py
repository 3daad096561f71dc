"""The figures of a body show that body: its own limits, taxels, projections and turns, whatever body it is."""

import math
from pathlib import Path

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidArray, InvalidPosture, NotVisible
from bodyimage_kin.estimators import PaperMLP
from bodyimage_kin.figures import body_figures, style
from bodyimage_kin.figures.specification import limbs, link_masses, table_1
from bodyimage_kin.recordings import Noise

URDF = Path(__file__).parents[2] / "urdf" / "infant.urdf"
# Another body: the other arm, its first joint unfelt; the other eye; a smaller, oblong grid; names of its own.
OTHER = f"""
name = "other"
urdf = {str(URDF)!r}
joints = ["right_shoulder_roll", "right_shoulder_yaw", "right_elbow", "right_wrist"]
[home]
right_shoulder_pitch = 1.52
right_shoulder_roll = 0.17
right_shoulder_yaw = 0.8
right_elbow = 1.67
right_wrist = 0.05
[hand]
link = "right_hand"
offset = [0.0, 0.0, 0.0]
radius = 0.02
[camera]
link = "left_eye"
model = "virtual_screen"
distance = 0.03
near = 0.05
half_angle_degrees = 50.0
forward = [1.0, 0.0, 0.0]
right = [0.0, -1.0, 0.0]
[skin]
link = "head"
shape = [5, 7]
size = [0.03, 0.05]
centre = [0.0824, 0.0, 0.06]
forward = [1.0, 0.0, 0.0]
right = [0.0, -1.0, 0.0]
reference = "brow"
eye = "brow"
[skin.landmarks]
brow = [0, 0]
chin = [4, 3]
"""
BRANCHED = """<robot name="r">
  <link name="base"><inertial><mass value="2"/></inertial></link>
  <link name="bar"><inertial><mass value="0.5"/></inertial></link>
  <link name="tray"><inertial><mass value="0.25"/></inertial></link>
  <link name="wheel"/><link name="left"/><link name="right"/><link name="nail"/>
  <joint name="slide" type="prismatic"><parent link="base"/><child link="bar"/>
    <axis xyz="0 0 1"/><limit lower="-0.1" upper="0.25" effort="1" velocity="1"/></joint>
  <joint name="weld" type="fixed"><parent link="bar"/><child link="tray"/><origin xyz="0.3 0 0"/></joint>
  <joint name="spin" type="continuous"><parent link="tray"/><child link="wheel"/>
    <origin xyz="0 0.4 0"/><axis xyz="0 0 1"/></joint>
  <joint name="open" type="revolute"><parent link="wheel"/><child link="left"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="2" effort="1" velocity="1"/></joint>
  <joint name="also" type="revolute"><parent link="wheel"/><child link="right"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="2" effort="1" velocity="1"/><mimic joint="open"/></joint>
  <joint name="glue" type="fixed"><parent link="left"/><child link="nail"/><origin xyz="0 0 0.02"/></joint>
</robot>"""


@pytest.fixture(scope="module")
def other(tmp_path_factory):
    path = tmp_path_factory.mktemp("other") / "other.toml"
    path.write_text(OTHER)
    return bk.load_embodiment(path)


@pytest.fixture(scope="module", params=["infant", "other"])
def any_body(request, other):
    return other if request.param == "other" else bk.load_embodiment("infant")


def round_the_screen(body):
    """Postures whose hand goes round once, clockwise to the eye, in front of the face."""
    angle = np.linspace(0, 2 * np.pi, 41)
    patch, radius = body.skin.patch, 0.02
    middle = body.hand_in_skin(body.felt_home)[None].numpy()
    aside = np.cos(angle)[:, None] * patch.right + np.sin(angle)[:, None] * patch.down
    q, reached = body.reach(torch.from_numpy(middle + radius * aside))
    assert reached.all()
    return q


MADE = {
    "posture_grid": lambda body: body_figures.posture_grid(body, round_the_screen(body)[:12].reshape(2, 6, -1)),
    "specification": body_figures.specification,
    "face": body_figures.face,
    "virtual_screen": lambda body: body_figures.virtual_screen(
        body, {"at rest": body.felt_home, "moved": round_the_screen(body)[0]}
    ),
    "seen_circle": lambda body: body_figures.seen_circle(body, round_the_screen(body)),
}


def texts(axes):
    return [text.get_text() for text in axes.texts]


def lines(axes, name):
    return [line.get_xydata() for line in axes.get_lines() if line.get_label() == name]


@pytest.fixture(scope="module")
def made():
    """Every figure of every body, made once."""
    figures = {}

    def make(name, body):
        if (name, body.name) not in figures:
            figures[name, body.name] = MADE[name](body)
        return figures[name, body.name]

    return make


@pytest.mark.parametrize("name", MADE)
def test_figures_of_any_body_are_small_and_whole(tmp_path, name, any_body, made):
    figure = made(name, any_body)
    saved = style.save(figure, tmp_path, name)
    assert saved[0].stat().st_size < 500_000
    assert figure.get_figwidth() == pytest.approx(style.DOUBLE_COLUMN)
    drawn = figure.get_tightbbox().get_points()
    assert (drawn >= -0.03).all(), "something is cut off"
    assert (drawn <= figure.get_size_inches() + 0.03).all(), "something is cut off"


@pytest.mark.parametrize("name", MADE)
def test_the_same_body_gives_the_same_bytes(tmp_path, name, body, made):
    first, anew = (
        style.save(figure, tmp_path, f"{name}{i}") for i, figure in enumerate([made(name, body), MADE[name](body)])
    )
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in anew]


def test_the_table_holds_the_robots_own_limits_lengths_and_masses(any_body, made):
    robot = any_body.robot
    table = next(axes for axes in made("specification", any_body).axes if axes.get_label() == "table")
    rows = {}
    for text in table.texts:
        rows.setdefault(round(text.get_position()[1], 3), []).append(text.get_text())
    by_name = {cell: row for row in rows.values() for cell in row}
    for index, name in enumerate(robot.joint_names):
        lower, upper = (f"{round(math.degrees(float(x[index])))}" for x in (robot.lower, robot.upper))
        row = by_name[name.replace("_", " ")]
        assert f"{lower} to {upper}".replace("-", "\N{MINUS SIGN}") in row
        felt = name in any_body.joints
        assert len(row) == 4 + felt
        assert not felt or row[0] == str(any_body.joints.index(name) + 1)
    freedoms = [int(cell.split()[0]) for cell in texts(table) if "of freedom" in cell and "kg" not in cell]
    assert sum(freedoms) == robot.n
    listed = sum(row.mass or 0 for limb in limbs(robot) for row in limb.joints)
    trunk = sum(link_masses(robot)[link] for link in ("pelvis", "torso"))
    assert listed + trunk == pytest.approx(sum(link_masses(robot).values()))
    named = texts(made("specification", any_body).axes[0])
    assert [text for text in named if "cm" not in text] == [
        f"{any_body.joints.index(name) + 1}  {name.replace('_', ' ')}" for name in any_body.joints
    ]


def test_lengths_are_the_distances_between_joints():
    robot = bk.Robot.from_urdf(URDF)
    pose = bk.kinematics(robot, "pinocchio").pose
    place = {link: pose(torch.zeros(robot.n, dtype=torch.float64), link)[:3, 3] for link in robot.link_names}
    for limb in limbs(robot):
        for row, after in zip(limb.joints, limb.joints[1:], strict=False):
            distance = torch.linalg.vector_norm(place[after.joint.child] - place[row.joint.child])
            assert row.length == pytest.approx(float(distance), abs=1e-12)
    arm = next(limb for limb in limbs(robot) if limb.tip == "left_hand")
    assert arm.joints[-1].length == pytest.approx(
        float(torch.linalg.vector_norm(place["left_hand"] - place["left_palm"]))
    )


def test_limbs_branch_slide_spin_and_follow():
    trunk, left, right = limbs(bk.Robot.from_urdf(BRANCHED))
    assert [(limb.base, limb.tip, limb.degrees_of_freedom) for limb in (trunk, left, right)] == [
        ("base", "wheel", 2),
        ("wheel", "nail", 1),
        ("wheel", "right", 0),
    ]
    slide, spin = trunk.joints
    assert (slide.limits, slide.length, slide.mass) == ("\N{MINUS SIGN}100 to 250 mm", pytest.approx(0.5), 0.75)
    assert (spin.limits, spin.length, spin.mass) == ("unlimited", None, None)
    assert left.joints[0].length == pytest.approx(0.02)
    assert right.joints[0].limits == "follows open"


def test_every_taxel_of_the_face_is_drawn_once_and_the_reference_is_ringed(any_body, made):
    front = made("face", any_body).axes[0]
    rows, columns = any_body.skin.shape
    plain = front.patches[0].get_path().vertices[::2]
    marked = np.concatenate([lines(front, name)[0] for name in any_body.skin.landmarks])
    assert len(plain) + len(marked) == rows * columns
    everything = np.concatenate([plain, marked])
    # Seen from the front a column of taxels is a column, and the robot's right is on the left.
    step = any_body.skin.patch.size[1] / (columns - 1)
    assert np.ptp(everything[:, 0]) == pytest.approx(step * (columns - 1), abs=1e-6)
    for name, taxel in any_body.skin.landmarks.items():
        row, column = divmod(taxel, columns)
        around = len(range(max(0, row - 1), min(rows, row + 2))) * len(
            range(max(0, column - 1), min(columns, column + 2))
        )
        assert len(lines(front, name)[0]) == around
    ring = lines(front, "reference")[0][0]
    column = any_body.skin.reference % columns
    assert ring[0] == pytest.approx(((columns - 1) / 2 - column) * step, abs=1e-6)
    assert f"taxels, {rows} \u00d7 {columns}" in [text.get_text() for text in front.figure.legends[0].get_texts()]


def test_the_hand_is_projected_as_the_camera_does(any_body):
    postures = {"one": any_body.felt_home, "two": round_the_screen(any_body)[3]}
    figure = body_figures.virtual_screen(any_body, postures)
    side, above = figure.axes
    h_z = 1000 * any_body.camera.screen.distance
    for name, q in postures.items():
        image, hand = 1000 * any_body.hand_image(q), 1000 * any_body.hand_in_camera(q)
        for axes, axis in ((side, 1), (above, 0)):
            assert lines(axes, f"image: {name}")[0][0] == pytest.approx([h_z, float(image[axis])])
            assert lines(axes, f"hand: {name}")[0][0] == pytest.approx([float(hand[2]), float(hand[axis])])
        numbers = [f"{float(value):.1f}".replace("-", "\N{MINUS SIGN}") for value in (*hand, *image)]
        said = next(
            t.get_text() for legend in figure.legends for t in legend.get_texts() if f"hand {name}:" in t.get_text()
        )
        assert all(number in said for number in numbers)
    assert side.get_ylim()[0] > side.get_ylim()[1], "y runs down"
    assert (side.get_xlabel(), side.get_ylabel(), above.get_ylabel()) == ("z [mm]", "y [mm]", "x [mm]")
    assert lines(side, "screen")[0][:, 0] == pytest.approx([h_z, h_z])


def test_the_profile_is_the_skin(any_body):
    side, above = body_figures.virtual_screen(any_body, {"one": any_body.felt_home}).axes
    for axes in (side, above):
        profile, taxels = lines(axes, "profile")[0], lines(axes, "taxels")[0]
        assert len(taxels) >= 5
        # A taxel up to half a step off the section lies a little behind the profile.
        step = 1000 * max(np.divide(any_body.skin.patch.size, np.subtract(any_body.skin.shape, 1)))
        depth = np.interp(taxels[:, 1], profile[:, 1], profile[:, 0])
        assert np.abs(taxels[:, 0] - depth).max() < step / 4


def test_the_hand_touches_the_reference_by_default(body):
    figure = body_figures.virtual_screen(body)
    image = 1000 * body.hand_image(body.touch_postures([body.skin.reference]))[0]
    assert lines(figure.axes[0], "image: touching the right eye")[0][0, 1] == pytest.approx(float(image[1]))


def test_the_circle_and_its_senses_are_as_the_eye_sees_them(any_body, made):
    q = round_the_screen(any_body)
    outside, screen = made("seen_circle", any_body).axes
    image = 1000 * any_body.hand_image(q).numpy()
    assert lines(screen, "image")[0] == pytest.approx(image)
    assert screen.get_ylim()[0] > screen.get_ylim()[1]
    assert {"clockwise", "anticlockwise"} <= set(texts(screen))
    middle = (image.max(0) + image.min(0)) / 2

    def turning(arc):
        around = arc - middle
        return np.sign(
            np.cross(np.c_[around, 0 * around[:, :1]][:-1], np.c_[np.diff(arc, axis=0), np.zeros(len(arc) - 1)])[
                :, 2
            ].mean()
        )

    arcs = [line.get_xydata() for line in screen.get_lines() if len(line.get_xydata()) == 40]
    # The path itself was led right, then down: clockwise where y runs down.
    assert [turning(image), *map(turning, arcs)] == [1, 1, -1]
    for name, taxel in any_body.skin.landmarks.items():
        touching = any_body.touch_centres([taxel])
        there = any_body.reach(touching)
        if bool(there[1].all()):
            assert lines(screen, name)[0][0] == pytest.approx(1000 * any_body.hand_image(there[0])[0].numpy(), abs=1e-3)
    assert outside.get_title() == "seen from outside"


def test_drawings_stand_where_their_postures_stand_in_the_map(body):
    postures = np.tile(body.felt_home, (2, 6, 1))
    postures[1, 2] = body.touch_postures([body.skin.reference])[0]
    figure = body_figures.posture_grid(
        body, postures, view=body_figures.View.around((0, 0, 0), azimuth=40, elevation=10)
    )
    drawings = {axes.get_label(): axes for axes in figure.axes if axes.images}
    assert list(drawings) == [f"{row},{column}" for row in range(2) for column in range(6)]
    pictures = {label: np.asarray(axes.images[0].get_array()) for label, axes in drawings.items()}
    assert {label for label in pictures if not np.array_equal(pictures[label], pictures["0,0"])} == {"1,2"}
    assert drawings["0,0"].get_position().y0 > drawings["1,0"].get_position().y0
    assert drawings["0,0"].get_position().x0 < drawings["0,1"].get_position().x0


def test_table_1_says_what_was_run_and_what_the_paper_has():
    rows = table_1(
        gamma=40.0,
        screen_distance=0.04,
        quiet=PaperMLP(),
        noisy=PaperMLP(steps=500),
        noise=Noise(torque=0.1),
    )
    assert [row.paper for row in rows] == ["40", "0.04 m", "0.2", "200", "10", "0.2", "500", "10", "0.0", "0.01"]
    assert [row.ours.split(" N")[0] for row in rows] == [row.paper for row in rows]
    other = table_1(gamma=9, screen_distance=0.05, quiet=PaperMLP(hidden=7, learning_rate=0.1, steps=3))
    assert [row.ours for row in other] == ["9", "0.05 m", "0.1", "3", "7"] + 5 * ["\N{EN DASH}"]


def test_what_cannot_be_drawn_is_refused(body):
    with pytest.raises(InvalidArray, match="postures has shape"):
        body_figures.posture_grid(body, np.zeros((2, 2, body.p + 1)))
    with pytest.raises(InvalidPosture, match="one or two"):
        body_figures.virtual_screen(body, {})
    with pytest.raises(NotVisible):
        body_figures.virtual_screen(body, {"behind": torch.zeros(body.p)})
    with pytest.raises(InvalidArray, match="at least 3"):
        body_figures.seen_circle(body, np.full((9, body.p), np.nan))
