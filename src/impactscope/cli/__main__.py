"""``python -m impactscope.cli``."""

import sys

from impactscope.cli.program import main

sys.exit(main())
