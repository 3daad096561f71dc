"""The face as an atlas: what an estimator's error is made of, taxel by taxel."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from bodyimage_kin.errors import InvalidArray
from bodyimage_kin.figures import style
from bodyimage_kin.figures._panels import ArrayLike, letters, numbers


@style.style()
def face_atlas(maps: Mapping[str, ArrayLike], *, limits: Mapping[str, tuple[float, float]] | None = None) -> Figure:
    """Heat maps over the taxels of the face, as the eye sees it: columns to the right, rows down.

    Args:
        maps: Title -> (rows, columns) values; NaN stays blank.
        limits: Title -> lowest and highest value of its colours; where missing, from 0 to the highest value.

    Returns:
        A panel for each map, with a scale of its own.

    Raises:
        InvalidArray: No map, or one that is not (rows, columns).
    """
    if not maps:
        raise InvalidArray("maps is empty; give at least one map of the face")
    figure = style.new_figure(style.DOUBLE_COLUMN, 0.4 + 1.05 * style.DOUBLE_COLUMN / len(maps))
    panels = figure.subplots(1, len(maps), squeeze=False)[0]
    for axes, (title, values) in zip(panels, maps.items(), strict=True):
        grid = numbers(values, f"map {title!r}", None, None)
        finite = grid[np.isfinite(grid)]
        low, high = (limits or {}).get(title, (0.0, float(finite.max()) if finite.size else 1.0))
        image = axes.imshow(grid, cmap="cividis", vmin=low, vmax=max(high, low + 1e-12), interpolation="nearest")
        figure.colorbar(image, ax=axes, location="bottom", shrink=0.85, pad=0.03)
        axes.set(title=title, xticks=[], yticks=[])
        for spine in axes.spines.values():
            spine.set_visible(False)
    letters(panels)
    return figure
