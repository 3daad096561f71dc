"""The experiment of Fuke, Ogino and Asada (2007), with the analytic truth beside everything that is learned."""

from bodyimage_kin.study.fuke2007.blindness import DOSES as DOSES
from bodyimage_kin.study.fuke2007.blindness import FALSE_ALARMS as FALSE_ALARMS
from bodyimage_kin.study.fuke2007.blindness import MEASURES as MEASURES
from bodyimage_kin.study.fuke2007.blindness import Blindness as Blindness
from bodyimage_kin.study.fuke2007.blindness import power as power
from bodyimage_kin.study.fuke2007.cell import BLINDNESS as BLINDNESS
from bodyimage_kin.study.fuke2007.cell import Cell as Cell
from bodyimage_kin.study.fuke2007.cell import run_cell as run_cell
from bodyimage_kin.study.fuke2007.claims import CLAIMS as CLAIMS
from bodyimage_kin.study.fuke2007.claims import Claim as Claim
from bodyimage_kin.study.fuke2007.claims import judge as judge
from bodyimage_kin.study.fuke2007.conditions import CONDITIONS as CONDITIONS
from bodyimage_kin.study.fuke2007.conditions import DIRECT as DIRECT
from bodyimage_kin.study.fuke2007.conditions import MOTIONS as MOTIONS
from bodyimage_kin.study.fuke2007.conditions import PARTS as PARTS
from bodyimage_kin.study.fuke2007.conditions import PROBES as PROBES
from bodyimage_kin.study.fuke2007.conditions import Condition as Condition
from bodyimage_kin.study.fuke2007.conditions import Motion as Motion
from bodyimage_kin.study.fuke2007.conditions import Settings as Settings
from bodyimage_kin.study.fuke2007.run import by_condition as by_condition
from bodyimage_kin.study.fuke2007.run import check as check
from bodyimage_kin.study.fuke2007.run import permuted_error as permuted_error
from bodyimage_kin.study.fuke2007.run import run as run
from bodyimage_kin.study.fuke2007.run import summarise as summarise
from bodyimage_kin.study.fuke2007.run import write_summary as write_summary
from bodyimage_kin.study.fuke2007.scene import true_map as true_map
