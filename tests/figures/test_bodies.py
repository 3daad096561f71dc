"""The figures of a body show that body: its own limits, taxels, projections and turns, whatever body it is."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin import figures
from bodyimage_kin.body.cameras import Camera, Tracker
from bodyimage_kin.errors import InvalidArray, InvalidConfig, InvalidPosture, NotVisible

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
    patch, radius = body.skin.layout, 0.02
    middle = body.hand_in_skin(body.felt_home)[None].numpy()
    aside = np.cos(angle)[:, None] * patch.right + np.sin(angle)[:, None] * patch.down
    q, reached = body.reach(torch.from_numpy(middle + radius * aside))
    assert reached.all()
    return q


TURN = np.linspace(0, 6.3, 50)


def of_one(draw):
    """A figure of one panel, with its legend."""

    def make(body):
        with figures.style():
            figure, grid = figures.panels(width=5, height=3.6)
            draw(body, grid[0, 0])
            figures.legend(figure)
        return figure

    return make


def circle_before_the_face(body):
    skin = body.skin.positions.numpy()
    middle = skin.mean(0) + np.array([0.05, 0, 0])
    return middle + 0.04 * np.stack([0 * TURN, np.cos(TURN), np.sin(TURN)], 1)


MADE = {
    "robot": of_one(lambda body, ax: figures.robot(body, None, ax, paths={"circle": circle_before_the_face(body)})),
    "close": of_one(
        lambda body, ax: figures.robot(
            body, body.touch_postures([0])[0], ax, paths={"circle": circle_before_the_face(body)}, close=True
        )
    ),
    "postures": of_one(lambda body, ax: figures.postures(body, round_the_screen(body)[:12].reshape(2, 6, -1), ax)),
    "joints": of_one(figures.joints),
    "skin": of_one(lambda body, ax: figures.skin(body, ax=ax)),
    "aside": of_one(lambda body, ax: figures.skin(body, ax=ax, turn=50)),
    "flat": of_one(lambda body, ax: figures.skin(body, ax=ax, flat=True)),
    "coloured": of_one(lambda body, ax: figures.skin(body, np.arange(body.skin.count), ax, label="number")),
    "face": of_one(lambda body, ax: figures.face(body, np.arange(body.skin.count), ax, label="number")),
    "screen": of_one(
        lambda body, ax: figures.virtual_screen(
            body, {"at rest": body.felt_home, "moved": round_the_screen(body)[0]}, ax
        )
    ),
    "sight": of_one(lambda body, ax: figures.line_of_sight(body, round_the_screen(body), ax)),
    "image": of_one(lambda body, ax: figures.hand_image(body, round_the_screen(body), ax)),
}


def texts(axes):
    return [text.get_text() for text in axes.texts]


def lines(axes, name):
    return [line.get_xydata() for line in axes.get_lines() if line.get_label() == name and len(line.get_xydata())]


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


@pytest.fixture(scope="module")
def made():
    """Every figure of every body, made once."""
    known = {}

    def make(name, body):
        if (name, body.name) not in known:
            known[name, body.name] = MADE[name](body)
        return known[name, body.name]

    return make


@pytest.mark.parametrize("name", MADE)
def test_figures_of_any_body_are_small_and_whole(tmp_path, name, any_body, made):
    figure = made(name, any_body)
    saved = figures.save(figure, tmp_path, name)
    assert saved[0].stat().st_size < 500_000
    drawn = figure.get_tightbbox().get_points()
    assert (drawn >= -0.03).all(), "something is cut off"
    assert (drawn <= figure.get_size_inches() + 0.03).all(), "something is cut off"


@pytest.mark.parametrize("name", MADE)
def test_the_same_body_gives_the_same_bytes(tmp_path, name, body, made):
    first, anew = (
        figures.save(figure, tmp_path, f"{name}{i}") for i, figure in enumerate([made(name, body), MADE[name](body)])
    )
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in anew]


def test_every_taxel_is_drawn_once_and_the_reference_is_ringed(any_body, made):
    front = made("skin", any_body).axes[0]
    rows, columns = any_body.skin.shape
    plain = front.patches[0].get_path().vertices[::2]
    names = [name.replace("_", " ") for name in any_body.skin.landmarks]
    marked = np.concatenate([lines(front, name)[0] for name in names])
    assert len(plain) + len(marked) == rows * columns
    everything = np.concatenate([plain, marked])
    # Seen from the front a column of taxels is a column, and the robot's right is on the left.
    step = any_body.skin.layout.size[1] / (columns - 1)
    assert np.ptp(everything[:, 0]) == pytest.approx(step * (columns - 1), abs=1e-6)
    for name, taxel in zip(names, any_body.skin.landmarks.values(), strict=True):
        row, column = divmod(taxel, columns)
        around = len(range(max(0, row - 1), min(rows, row + 2))) * len(
            range(max(0, column - 1), min(columns, column + 2))
        )
        assert len(lines(front, name)[0]) == around
    ring = lines(front, "reference taxel")[0][0]
    column = any_body.skin.reference % columns
    assert ring[0] == pytest.approx(((columns - 1) / 2 - column) * step, abs=1e-6)
    assert f"taxels, {rows} \u00d7 {columns}" in legend(front.figure)


def test_a_skin_laid_flat_keeps_its_distances(any_body, made):
    flat = made("flat", any_body).axes[0]
    assert (flat.get_xlabel(), flat.get_aspect()) == ("along the skin [mm]", 1)
    assert "laid flat" in flat.get_title()
    names = [name.replace("_", " ") for name in any_body.skin.landmarks]
    places = flat.patches[0].get_path().vertices[::2]
    skin = any_body.skin
    # A head curves: neighbours stay neighbours, and the whole is as wide as it is along the surface.
    across = 1000 * np.linalg.norm(np.diff(skin.positions.numpy().reshape(*skin.shape, 3), axis=1), axis=-1).sum(1)
    everything = np.concatenate([places, *(lines(flat, name)[0] for name in names)])
    assert np.ptp(everything[:, 0]) == pytest.approx(across.max(), rel=0.15)
    # As it is seen: the robot's right on the left, its crown on top.
    assert (
        np.sign(lines(flat, "reference taxel")[0][0]).tolist()
        == np.sign(lines(made("skin", any_body).axes[0], "reference taxel")[0][0]).tolist()
    )


def test_values_stand_where_their_taxels_do(any_body, made):
    rows, columns = any_body.skin.shape
    image = next(image for image in made("face", any_body).axes[0].images)
    np.testing.assert_array_equal(image.get_array(), np.arange(rows * columns).reshape(rows, columns))
    shown = figures.values(made("face", any_body))
    assert len(shown[shown["series"] == "number"]) == rows * columns
    dots = made("coloured", any_body).axes[0].collections[0]
    by_value = dict(zip(dots.get_array(), dots.get_offsets()[:, 0], strict=True))
    step = any_body.skin.layout.size[1] / (columns - 1)
    for value, x in by_value.items():
        # The robot's right is on the left, columns grow to its own left or right as the patch says.
        assert abs(abs(x) - abs((columns - 1) / 2 - value % columns) * step) < 1e-6
    for draw in (figures.face, figures.skin):
        with pytest.raises(InvalidArray, match="one a taxel"):
            draw(any_body, np.zeros(3), made("face", any_body).axes[0])


def test_taxels_landmarks_and_paths_are_drawn_where_they_are_seen(body, made):
    far, close = (made(name, body).axes[0] for name in ("robot", "close"))
    assert len(far.images) == len(close.images) == 1
    assert np.ptp(far.get_xlim()) > np.ptp(close.get_xlim())
    assert {*texts(far), *texts(close)} == {"10 cm", "2 cm"}
    assert {"taxels", "circle", "nose"} <= set(legend(far.figure))
    # At home nothing is before the face but the marks that the view from aside has behind it.
    circle = [np.isfinite(one.get_xydata()).all(1) for one in close.get_lines() if len(one.get_xydata()) == len(TURN)]
    assert circle[0].sum() + circle[1].sum() == len(TURN)
    nose = body.touch_postures([body.skin.landmarks["nose"]])[0]
    touching = of_one(lambda body, ax: figures.robot(body, nose, ax, close=True))(body)
    assert "hollow: behind the hand" in legend(touching)
    with pytest.raises(InvalidArray, match="path 'way'"):
        figures.robot(body, None, close, paths={"way": np.zeros((4, 2))})
    with pytest.raises(InvalidPosture, match="last axis"):
        figures.robot(body, np.zeros(body.p + 1), close)


def test_felt_joints_are_named_and_numbered(any_body, made):
    named = texts(made("joints", any_body).axes[0])
    assert [text for text in named if "cm" not in text] == [
        f"{any_body.joints.index(name) + 1}  {name.replace('_', ' ')}" for name in any_body.joints
    ]


def test_a_body_without_skin_is_drawn(body):
    bare = dataclasses.replace(body, skin=None)
    for draw in (figures.robot, figures.joints):
        assert of_one(lambda body, ax, draw=draw: draw(body, ax=ax))(bare).axes[0].images
    assert of_one(lambda body, ax: figures.hand_image(body, np.tile(body.felt_home, (3, 1)), ax))(bare).axes[0].lines
    with pytest.raises(bk.errors.NoSkin):
        of_one(lambda body, ax: figures.skin(body, ax=ax))(bare)


@pytest.mark.parametrize("axis", [1, 0])
def test_the_hand_is_projected_as_the_camera_does(any_body, axis):
    postures = {"one": any_body.felt_home, "two": round_the_screen(any_body)[3]}
    axes = of_one(lambda body, ax: figures.virtual_screen(body, postures, ax, axis=axis))(any_body).axes[0]
    h_z = 1000 * any_body.camera.screen.distance
    for name, q in postures.items():
        image, hand = 1000 * any_body.hand_image(q), 1000 * any_body.hand_in_camera(q)
        assert lines(axes, f"its image, {name}")[0][0] == pytest.approx([h_z, float(image[axis])])
        assert lines(axes, f"hand {name}")[0][0] == pytest.approx([float(hand[2]), float(hand[axis])])
    assert axes.get_ylim()[0] > axes.get_ylim()[1], "y runs down"
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("z [mm]", f"{'xy'[axis]} [mm]")
    assert lines(axes, f"virtual screen, z = {h_z:g} mm")[0][:, 0] == pytest.approx([h_z, h_z])


@pytest.mark.parametrize("axis", [1, 0])
def test_the_profile_is_the_skin(any_body, axis):
    draw = of_one(lambda body, ax: figures.virtual_screen(body, {"one": body.felt_home}, ax, axis=axis))
    axes = draw(any_body).axes[0]
    profile, taxels = lines(axes, "head, section")[0], lines(axes, "taxels near the section")[0]
    assert len(taxels) >= 5
    # A taxel up to half a step off the section lies a little behind the profile.
    step = 1000 * max(np.divide(any_body.skin.layout.size, np.subtract(any_body.skin.shape, 1)))
    depth = np.interp(taxels[:, 1], profile[:, 1], profile[:, 0])
    assert np.abs(taxels[:, 0] - depth).max() < step / 4


def test_the_hand_touches_the_reference_by_default(body):
    axes = of_one(lambda body, ax: figures.virtual_screen(body, None, ax))(body).axes[0]
    image = 1000 * body.hand_image(body.touch_postures([body.skin.reference]))[0]
    assert lines(axes, "its image, touching the right eye")[0][0, 1] == pytest.approx(float(image[1]))


def test_the_circle_and_its_senses_are_as_the_eye_sees_them(any_body, made):
    q = round_the_screen(any_body)
    outside, screen = (made(name, any_body).axes[0] for name in ("sight", "image"))
    image = 1000 * any_body.hand_image(q).numpy()
    assert lines(screen, "image of the hand")[0] == pytest.approx(image)
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
        there = any_body.reach(any_body.touch_centres([taxel]))
        if bool(there[1].all()):
            (mark,) = lines(screen, f"_: {name.replace('_', ' ')}")
            assert mark[0] == pytest.approx(1000 * any_body.hand_image(there[0])[0].numpy(), abs=1e-3)
    assert {"line of sight", "optical centre", "clockwise, to the eye"} <= set(legend(outside.figure))


def test_drawings_stand_where_their_postures_stand_in_the_map(body):
    postures = np.tile(body.felt_home, (2, 6, 1))
    postures[1, 2] = body.touch_postures([body.skin.reference])[0]
    axes = of_one(lambda body, ax: figures.postures(body, postures, ax))(body).axes[0]
    picture = np.asarray(axes.images[0].get_array())
    tall, wide = picture.shape[0] // 2, picture.shape[1] // 6
    tiles = {
        (row, column): picture[row * tall :][:tall, column * wide :][:, :wide] for row in (0, 1) for column in range(6)
    }
    assert {place for place, tile in tiles.items() if not np.array_equal(tile, tiles[0, 0])} == {(1, 2)}
    assert axes.get_ylim()[0] > axes.get_ylim()[1], "rows run down"
    assert [label.get_text() for label in axes.get_yticklabels()] == ["1", "2"]
    # The joints of each are the values of the drawing.
    table = figures.values(axes.figure)
    assert len(table) == postures.size
    of = table[(table["row of the map"] == "2") & (table["column of the map"] == "3")]
    assert of["value"].to_numpy() == pytest.approx(postures[1, 2], rel=1e-5)
    assert of["series"].tolist() == [figures.label(name) for name in body.joints]


def test_what_cannot_be_drawn_is_refused(body):
    with figures.style():
        axes = figures.panels()[1][0, 0]
    with pytest.raises(InvalidArray, match="postures has shape"):
        figures.postures(body, np.zeros((2, 2, body.p + 1)), axes)
    with pytest.raises(InvalidPosture, match="one or two"):
        figures.virtual_screen(body, {}, axes)
    with pytest.raises(NotVisible):
        figures.virtual_screen(body, {"behind": torch.zeros(body.p)}, axes)
    with pytest.raises(InvalidArray, match="at least 3"):
        figures.line_of_sight(body, np.full((9, body.p), np.nan), axes)
    seen = dataclasses.replace(body, camera=Camera(body.camera.link, body.camera.link_T_camera, Tracker()))
    with pytest.raises(InvalidConfig, match="virtual screen"):
        figures.virtual_screen(seen, None, axes)
