"""Bodies: a robot with felt joints, a hand, a camera, a skin, and a home posture."""

from bodyimage_kin.body.cameras import Camera as Camera
from bodyimage_kin.body.cameras import CameraModel as CameraModel
from bodyimage_kin.body.cameras import Stereo as Stereo
from bodyimage_kin.body.cameras import Tracker as Tracker
from bodyimage_kin.body.cameras import VirtualScreen as VirtualScreen
from bodyimage_kin.body.check import Finding as Finding
from bodyimage_kin.body.check import check_embodiment as check_embodiment
from bodyimage_kin.body.embodiment import Embodiment as Embodiment
from bodyimage_kin.body.embodiment import Frame as Frame
from bodyimage_kin.body.file import embodiments as embodiments
from bodyimage_kin.body.file import load_embodiment as load_embodiment
from bodyimage_kin.body.hand import Hand as Hand
from bodyimage_kin.body.pinhole import Pinhole as Pinhole
from bodyimage_kin.body.proposal import Proposal as Proposal
from bodyimage_kin.body.proposal import propose as propose
from bodyimage_kin.body.skin import Patch as Patch
from bodyimage_kin.body.skin import Skin as Skin
from bodyimage_kin.body.taxel_tables import TaxelTable as TaxelTable
from bodyimage_kin.body.taxel_tables import read_icub_taxels as read_icub_taxels
from bodyimage_kin.body.taxel_tables import read_nao_taxels as read_nao_taxels

__all__ = [
    "Camera",
    "CameraModel",
    "Embodiment",
    "Finding",
    "Frame",
    "Hand",
    "Patch",
    "Pinhole",
    "Proposal",
    "Skin",
    "Stereo",
    "TaxelTable",
    "Tracker",
    "VirtualScreen",
    "check_embodiment",
    "embodiments",
    "load_embodiment",
    "propose",
    "read_icub_taxels",
    "read_nao_taxels",
]
