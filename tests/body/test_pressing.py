"""What a hand touches that is pressed into the skin, and one that hovers over it."""

from __future__ import annotations

import numpy as np
import pytest

from bodyimage_kin.body import Embodiment


@pytest.mark.parametrize(("pressed", "felt"), [(-2e-3, False), (-5e-4, True), (0.0, True), (2e-3, True), (6e-3, True)])
def test_a_hand_pressed_in_touches_the_same_taxel_and_one_that_hovers_none(
    body: Embodiment, pressed: float, felt: bool
) -> None:
    skin = body.require_skin()
    taxels = np.arange(skin.count)
    centres = body.touch_centres(taxels).numpy() - pressed * skin.link_normals
    touched = skin.touched(centres, body.hand.radius)
    assert touched.tolist() == (taxels.tolist() if felt else [-1] * skin.count)
