"""How fast, and how exact: this package's kinematics beside other libraries', in one process, in turns."""

from bodyimage_kin.bench.measure import QUICK as QUICK
from bodyimage_kin.bench.measure import Settings as Settings
from bodyimage_kin.bench.measure import run as run
from bodyimage_kin.bench.tables import markdown as markdown
from bodyimage_kin.bench.tables import write as write
