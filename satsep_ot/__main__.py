"""`python -m satsep_ot`: the same as the command `satsep-ot`."""

import sys

from satsep_ot.cli import main

sys.exit(main())
