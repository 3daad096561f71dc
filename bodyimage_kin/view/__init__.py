"""Something to look at: a body, its recordings and what was learned from them, in a browser.

:class:`Scene` computes what is shown at a moment and needs no window. :func:`serve` shows it on a page that sliders
move, to this machine alone, and :func:`export` writes it as a page that needs nothing else; both need the extra
``view``.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from bodyimage_kin.errors import MissingDependency
from bodyimage_kin.view._opening import open_scene as open_scene
from bodyimage_kin.view.scene import Moment as Moment
from bodyimage_kin.view.scene import Scene as Scene

if TYPE_CHECKING:
    from bodyimage_kin.view._page import Page

__all__ = ["Moment", "Scene", "export", "open_scene", "serve"]


def serve(scene: Scene, port: int = 8080) -> Page:
    """Shows a scene in the browser, at ``page.address`` of this machine alone, until ``page.stop()``.

    Args:
        scene: What is shown.
        port: Where; the next free one is taken where it is in use.

    Raises:
        MissingDependency: viser is not installed.
    """
    _require_viser()
    from bodyimage_kin.view._page import Page

    return Page(scene, port)


def export(
    scene: Scene,
    path: str | os.PathLike[str],
    recording: str = "",
    estimator: str = "",
    frames: int = 60,
    colouring: str = "touches",
) -> Path:
    """Writes a scene as one HTML page that needs nothing else: it moves by itself, and can be turned.

    Args:
        scene: What is shown.
        path: The page.
        recording: Whose samples are gone through; empty: the first, or the body at home where there is none.
        estimator: Whose estimate is shown; empty: none.
        frames: Samples shown, over the whole recording.
        colouring: Of the skin, one of ``scene.colourings``.

    Raises:
        MissingDependency: viser is not installed.
        UnknownName: No such recording, estimator or colouring.
        InvalidConfig: Fewer than one frame.
    """
    _require_viser()
    from bodyimage_kin.view import _page

    return _page.export(scene, Path(path), recording, estimator, frames, colouring)


def _require_viser() -> None:
    try:
        import viser  # noqa: F401
    except ImportError:
        raise MissingDependency("the viewer needs viser; pip install 'bodyimage-kin[view]'") from None
