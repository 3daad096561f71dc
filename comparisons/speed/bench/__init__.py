"""How fast, and how exact: this package's kinematics beside other libraries', in one process, in turns."""

from bench.measure import QUICK as QUICK
from bench.measure import Settings as Settings
from bench.measure import run as run
from bench.tables import markdown as markdown
from bench.tables import write as write
