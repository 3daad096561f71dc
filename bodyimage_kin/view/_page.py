"""The interactive page: a scene in the browser, moved by sliders, served to this machine alone."""

from __future__ import annotations

import io
import threading
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path
from typing import Any

import numpy as np
import viser
from jaxtyping import Float
from matplotlib import colormaps

from bodyimage_kin._files import write_text
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.figures.visuals import Surface
from bodyimage_kin.view.scene import Moment, Scene

HOST = "127.0.0.1"


class _Server(viser.ViserServer):
    """A server that says nothing by itself, and opens no tunnel to the outside, whoever asks for one."""

    def __init__(self, port: int, label: str | None = None) -> None:
        with redirect_stdout(io.StringIO()):
            super().__init__(HOST, port, label, verbose=False)

    def stop(self) -> None:
        """Ends it."""
        with redirect_stdout(io.StringIO()):
            super().stop()

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuses."""
        return None


_TURN = 2 * np.pi
"""Of a joint without limits [rad], or metres of one that slides."""
_NONE, _POSTURE = "none", "a posture"
_TRUE, _ESTIMATE, _DOUBT, _MAP = (20, 20, 20), (194, 64, 126), (226, 160, 190), (74, 168, 224)
_GREY, _TOUCHED = (150, 150, 150), (230, 60, 0)
_LEGEND = (
    "**black**: the true hand, its image, and how unit joint motions move it; **magenta**: the estimate, its path "
    "since the last reset and the learned Jacobian; **pink**: two standard deviations; "
    "**blue**: the tactile map so far."
)


class Page:
    """A scene on a page of its own, at http://127.0.0.1:PORT."""

    def __init__(self, scene: Scene, port: int = 8080) -> None:
        """Serves a scene.

        Args:
            scene: What is shown.
            port: Where; the next free one is taken where it is in use.
        """
        self.scene = scene
        self.server = _Server(port, "bodyimage_kin")
        self._busy = threading.Lock()
        self._quiet = False
        self._drawing = _Drawing(self.server, scene)
        self._build()
        self.show()
        self._drawing.look_at(scene.posture(scene.body.felt_home))

    @property
    def address(self) -> str:
        """Where a browser finds it."""
        return f"http://{HOST}:{self.server.get_port()}"

    def stop(self) -> None:
        """Ends the page."""
        self.server.stop()

    def show(self) -> None:
        """Shows what sliders and selectors say."""
        with self._busy, self.server.atomic():
            estimator = "" if self.estimator.value == _NONE else self.estimator.value
            if self.recording.value == _POSTURE:
                q = [slider.value for slider in self.joints]
                moment = self.scene.posture(q, estimator, self.colouring.value)
            else:
                stops = self.scene.stops(self.recording.value, int(self.trial.value))
                index = int(stops[min(int(self.time.value), len(stops) - 1)]) if len(stops) else 0
                moment = self.scene.moment(
                    self.recording.value, index, estimator, self.colouring.value, int(self.trial.value)
                )
                with self._silent():
                    for slider, value in zip(self.joints, moment.q, strict=True):
                        slider.value = float(np.clip(np.nan_to_num(value), slider.min, slider.max))
            self._drawing.show(moment)
            self._drawing.ghosts.visible = self.ghosts.value
            self.words.content = "\n\n".join([*moment.says, *self.scene.notes])

    # Inner -----------------------------------------------------------------------------------------------------------

    def _build(self) -> None:
        gui, scene = self.server.gui, self.scene
        names = [*scene.recordings, _POSTURE]
        # The library's types have no setter of a handle's value.
        self.joints: list[Any] = []
        self.recording: Any = gui.add_dropdown("recording", names, initial_value=names[0])
        self.trial: Any = gui.add_number("trial", 0, min=0, max=1, step=1)
        self.time: Any = gui.add_slider("time", 0, 1, 1, 0)
        self.estimator: Any = gui.add_dropdown("estimator", [_NONE, *scene.estimators], initial_value=_NONE)
        self.colouring = gui.add_dropdown("skin", list(scene.colourings), initial_value="touches")
        self.ghosts: Any = gui.add_checkbox("next postures", True, visible=len(scene.q_ghosts) > 0)
        self.words = gui.add_markdown("")
        with gui.add_folder("joints"):
            felt = scene.body.felt_robot
            lower, upper = felt.lower.clamp(min=-_TURN).tolist(), felt.upper.clamp(max=_TURN).tolist()
            for name, low, high, home in zip(
                scene.body.joints, lower, upper, scene.body.felt_home.tolist(), strict=True
            ):
                high = max(high, low + 1e-6)
                start = min(max(home, low), high)
                self.joints.append(gui.add_slider(name, low, high, (high - low) / 1000, start))
        gui.add_markdown(_LEGEND)
        self._lengths()
        self.recording.on_update(lambda _: self._changed(lengths=True))
        self.trial.on_update(lambda _: self._changed(lengths=True))
        for handle in (self.time, self.estimator, self.colouring):
            handle.on_update(lambda _: self._changed())
        self.ghosts.on_update(lambda _: self._changed())
        for slider in self.joints:
            slider.on_update(lambda _: self._moved())

    def _changed(self, lengths: bool = False) -> None:
        if self._quiet:
            return
        if lengths:
            self._lengths()
        self.show()

    def _moved(self) -> None:
        """A joint was moved by hand: what is shown is no recording any more."""
        if self._quiet:
            return
        with self._silent():
            self.recording.value = _POSTURE
        self._lengths()
        self.show()

    def _lengths(self) -> None:
        name = self.recording.value
        with self._silent():
            recorded = name != _POSTURE
            trials = self.scene.trials(name) if recorded else 1
            self.trial.max = max(trials - 1, 0)
            self.trial.value = min(int(self.trial.value), trials - 1)
            last = len(self.scene.stops(name, int(self.trial.value))) - 1 if recorded else 0
            self.time.max = max(last, 1)
            self.time.value = min(int(self.time.value), max(last, 0))
            self.trial.visible, self.time.visible = trials > 1, recorded

    @contextmanager
    def _silent(self) -> Iterator[None]:
        """Values set by us ask for nothing to be shown."""
        before, self._quiet = self._quiet, True
        try:
            yield
        finally:
            self._quiet = before


class _Drawing:
    """The nodes of a scene in viser, and what each shows at a moment."""

    def __init__(self, server: viser.ViserServer, scene: Scene) -> None:
        self.scene = scene
        add = self.add = server.scene
        self.viewpoint = server.initial_camera
        add.set_up_direction("+z")
        add.configure_default_lights()
        self.size = _size_of(scene)
        thick = 0.0012 * self.size
        self.links = {
            name: self._link(f"/robot/{index}", surface) for index, (name, surface) in enumerate(scene.surfaces.items())
        }
        self.skin: Any = None
        if scene.body.skin is not None:
            skin = scene.body.skin
            self.base = add.add_frame("/skin", show_axes=False)
            lifted = skin.link_positions + 0.002 * self.size * skin.link_normals
            self.skin = add.add_point_cloud(
                "/skin/taxels",
                lifted,
                _GREY,
                point_size=0.4 * _spacing(lifted),
                point_shape="circle",
                precision="float32",
            )
        self.camera = add.add_frame("/camera", axes_length=0.04 * self.size, axes_radius=thick)
        corners = scene.sight.frame()
        if len(corners):
            rays = np.stack([np.zeros_like(corners), corners], axis=1)
            edges = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
            add.add_line_segments("/camera/picture", np.concatenate([rays, edges]), (90, 90, 90), thickness=thick / 2)
        dot = 0.012 * float(np.linalg.norm(corners[2] - corners[0])) if len(corners) else 0.01 * self.size
        self.dots = {
            "image": add.add_icosphere("/camera/image", dot, _TRUE),
            "estimate": add.add_icosphere("/camera/estimate", dot, _ESTIMATE),
        }
        radius = max(scene.body.hand.radius, 0.012 * self.size)
        self.hands = {
            "hand": add.add_icosphere("/hand", radius, _TRUE, opacity=0.6),
            "estimated_hand": add.add_icosphere("/estimated_hand", radius, _ESTIMATE, opacity=0.6),
        }
        lines = {
            "true_ellipse": _TRUE,
            "learned_ellipse": _ESTIMATE,
            "doubt": _DOUBT,
            "path": _ESTIMATE,
            "map": _MAP,
        }
        self.lines = {
            name: add.add_line_segments(f"/camera/{name}", np.zeros((1, 2, 3)), colour, thickness=dot / 5)
            for name, colour in lines.items()
        }
        self.edges = _edges(scene)
        self.ghosts: Any = add.add_frame("/ghosts", show_axes=False)
        self._ghosts()

    def show(self, moment: Moment) -> None:
        """Moves and paints what is there."""
        for name, handle in self.links.items():
            _put(handle, moment.links[name])
        if self.skin is not None:
            count = len(moment.values)
            _put(self.base, self._skin_pose(moment))
            shades = np.asarray(colormaps["cividis"](np.nan_to_num(moment.values))[:, :3] * 255, dtype=np.uint8)
            shades[np.isnan(moment.values)] = _GREY
            shades[[taxel for taxel in moment.touched if taxel < count]] = _TOUCHED
            self.skin.colors = shades
        _put(self.camera, moment.camera)
        for name, handle in (*self.dots.items(), *self.hands.items()):
            place = getattr(moment, name)
            handle.visible = bool(np.isfinite(place).all())
            if handle.visible:
                handle.position = place
        for name, handle in self.lines.items():
            points = getattr(moment, name)
            if name == "map":
                segments = points[self.edges] if len(points) else np.empty((0, 2, 3))
            else:
                segments = np.stack([points[:-1], points[1:]], axis=1) if len(points) > 1 else np.empty((0, 2, 3))
            segments = segments[np.isfinite(segments).all((1, 2))]
            handle.visible = bool(len(segments))
            if handle.visible:
                colour = handle.colors.reshape(-1, 3)[0]
                handle.colors = np.broadcast_to(colour, segments.shape).astype(np.uint8)
                handle.points = segments.astype(np.float32)

    def look_at(self, moment: Moment) -> None:
        """Puts the viewer obliquely before the hand, so near that the camera's picture is seen as well."""
        across = moment.camera[:3, :3] @ np.array([-0.55, -0.3, 0.8])
        middle = (moment.hand + moment.camera[:3, 3]) / 2
        self.viewpoint.look_at = middle
        self.viewpoint.position = middle + 0.5 * self.size * across / np.linalg.norm(across)

    def _skin_pose(self, moment: Moment) -> Float[np.ndarray, "4 4"]:
        link = self.scene.body.require_skin().link
        if link in moment.links:
            return moment.links[link]
        return self.scene.body.kinematics.pose(moment.q, link).numpy()

    def _link(self, name: str, surface: Surface, opacity: float | None = None) -> Any:
        frame = self.add.add_frame(name, show_axes=False)
        shades, which = np.unique(np.round(255 * surface.colours[:, :3]), axis=0, return_inverse=True)
        for index, shade in enumerate(shades):
            of = which.ravel() == index
            # Corners that have place and direction in common are one: edges stay sharp, and what is round stays so.
            corners = np.concatenate([surface.corners[of], np.round(surface.normals[of], 2)], axis=-1).reshape(-1, 6)
            kept, faces = np.unique(np.round(corners, 6), axis=0, return_inverse=True)
            self.add.add_mesh_simple(
                f"{name}/{index}",
                kept[:, :3].astype(np.float32),
                faces.reshape(-1, 3).astype(np.uint32),
                color=shade.astype(np.uint8),
                opacity=opacity,
                side="double",
            )
        return frame

    def _ghosts(self) -> None:
        for number, links in enumerate(self.scene.ghost_links()):
            for index, (name, pose) in enumerate(links.items()):
                _put(self._link(f"/ghosts/{number}/{index}", self.scene.surfaces[name], 0.2), pose)


def export(scene: Scene, path: Path, recording: str, estimator: str, frames: int, colouring: str) -> Path:
    """See :func:`bodyimage_kin.view.export`."""
    if frames < 1:
        raise InvalidConfig(f"frames={frames}; give at least one")
    recording = recording or next(iter(scene.recordings), "")
    server = _Server(0)
    try:
        drawing = _Drawing(server, scene)
        stops = scene.stops(recording) if recording else np.arange(0)
        shown = stops[np.unique(np.linspace(0, len(stops) - 1, frames).astype(int))] if len(stops) else []
        first = scene.moment(recording, int(shown[0]), estimator, colouring) if len(shown) else None
        drawing.show(first or scene.posture(scene.body.felt_home, estimator, colouring))
        drawing.look_at(first or scene.posture(scene.body.felt_home))
        serializer = server.get_scene_serializer()
        for index in shown[1:]:
            serializer.insert_sleep(0.1)
            drawing.show(scene.moment(recording, int(index), estimator, colouring))
        serializer.insert_sleep(0.5)
        write_text(path, serializer.as_html())
    finally:
        with suppress(RuntimeError):
            server.stop()
    return path


def _put(handle: Any, pose: Float[np.ndarray, "4 4"]) -> None:
    handle.position = pose[:3, 3]
    handle.wxyz = viser.transforms.SO3.from_matrix(pose[:3, :3]).wxyz


def _size_of(scene: Scene) -> float:
    """Of the robot about [m]."""
    moment = scene.posture(scene.body.felt_home)
    places = np.stack([pose[:3, 3] for pose in moment.links.values()] + [moment.hand, moment.camera[:3, 3]])
    return max(float(np.linalg.norm(np.ptp(places, axis=0))), 0.05)


def _spacing(places: Float[np.ndarray, "taxels 3"]) -> float:
    """Median distance of a taxel to the next [m]."""
    apart = np.linalg.norm(places[:, None] - places[None], axis=-1) + np.diag(np.full(len(places), np.inf))
    return float(np.median(apart.min(1))) if len(places) > 1 else 0.005


def _edges(scene: Scene) -> Any:
    """Pairs of neighbouring taxels."""
    skin = scene.body.skin
    return np.empty((0, 2), dtype=int) if skin is None else skin.neighbours
