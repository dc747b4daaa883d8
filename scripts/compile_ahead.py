"""Compile what is compiled at its first use, so that no first answer waits for it.

The machine code is kept beside the installed package. Two small searches, ended as soon as may be,
use the twin of the bench and the driven systems.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from impactscope.campaign_files import explain_folder
from impactscope.drivers.simulated_campaign import write_campaign

BAGS = Path(__file__).resolve().parent.parent / 'bags'


def main() -> int:
    """Use each part once; nothing is kept of it."""
    with tempfile.TemporaryDirectory() as folder:
        write_campaign(Path(folder), (), layered=True, seed=0, blows=2)
        explain_folder(folder, within_s=1.0)
    explain_folder(BAGS / 'pendulum_campaign.yaml', within_s=1.0)
    return 0


if __name__ == '__main__':
    sys.exit(main())
