"""The whole table: every number printed in the paper, section by section."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from impactscope.errors import InputError
from impactscope.paper.appendix_rows import appendix_rows
from impactscope.paper.bench_rows import bench_rows, device_rows, model_rows, pendulum_rows
from impactscope.paper.blow_rows import blow_rows
from impactscope.paper.damper_rows import damper_rows
from impactscope.paper.row import PaperRow
from impactscope.paper.sensor_rows import sensor_rows
from impactscope.paper.shock_rows import shock_rows

__all__ = ['PARTS', 'rows']

PARTS: dict[str, Callable[[], list[PaperRow]]] = {
    'Devices (Table 1)': device_rows,
    'Set-up (2.1)': bench_rows,
    'Pendulum (2.2)': pendulum_rows,
    'Model (2.3)': model_rows,
    'Sensor (3.1.1)': sensor_rows,
    'Short contacts (3.1.1, Fig. 9) and a better sensor (4)': shock_rows,
    'Pendulum on the sensor (3.2)': blow_rows,
    'Damper layer (3.3)': damper_rows,
    'Contact model (Appendix A)': appendix_rows,
}
"""Heading to the function that computes its rows, in the paper's order."""


def rows() -> list[PaperRow]:
    """All rows, computed now. Raises InputError should two rows have one id."""
    table = [item for part in PARTS.values() for item in part()]
    repeated = [key for key, count in Counter(r.id for r in table).items() if count > 1]
    if repeated:
        raise InputError(f'row {repeated[0]!r} stands twice in the table')
    return table
