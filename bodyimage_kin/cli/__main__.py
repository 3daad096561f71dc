"""``python -m bodyimage_kin.cli``, for where the command is not on the path."""

import sys

from bodyimage_kin.cli import main

sys.exit(main())
