"""Published studies, each a grid of cells and a judgement of what comes out."""

from bodyimage_kin.published import ambiguities as ambiguities
from bodyimage_kin.published import foreknowledge as foreknowledge
from bodyimage_kin.published import fuke2007 as fuke2007

__all__ = ["ambiguities", "foreknowledge", "fuke2007"]
