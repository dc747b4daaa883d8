"""``python -m impactscope``."""

import sys

from impactscope.cli.program import main

sys.exit(main())
