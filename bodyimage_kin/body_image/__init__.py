"""From a learned Jacobian to a body image: integration of the unseen hand, and the maps learned from it."""

from bodyimage_kin.body_image.doubt import BodyImageDraws as BodyImageDraws
from bodyimage_kin.body_image.doubt import integrate_draws as integrate_draws
from bodyimage_kin.body_image.hebbian import HebbianMap as HebbianMap
from bodyimage_kin.body_image.hebbian import hebbian_map as hebbian_map
from bodyimage_kin.body_image.integration import integrate as integrate
from bodyimage_kin.body_image.kernel import activation as activation
from bodyimage_kin.body_image.kernel import expected_map as expected_map
from bodyimage_kin.body_image.maps import BodyImage as BodyImage
from bodyimage_kin.body_image.posture_som import PostureSOM as PostureSOM
from bodyimage_kin.body_image.posture_to_image import PostureToImage as PostureToImage

__all__ = [
    "BodyImage",
    "BodyImageDraws",
    "HebbianMap",
    "PostureSOM",
    "PostureToImage",
    "activation",
    "expected_map",
    "hebbian_map",
    "integrate",
    "integrate_draws",
]
