"""The confusion matrix as a picture (SVG), drawn without a plotting library."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

__all__ = ['confusion_svg']

_CELL, _LEFT, _TOP = 22, 230, 200


def confusion_svg(
    counts: Mapping[tuple[str, str], int], title: str = 'Truth against first answer'
) -> str:
    """A matrix: truths as rows, first answers as columns, shares of the row as darkness.

    Args:
        counts: (truth, answer) to how often.
        title: above the picture.
    """
    rows = sorted({t for t, _ in counts}, key=_order)
    columns = sorted({a for _, a in counts} | set(rows), key=_order)
    width = _LEFT + _CELL * len(columns) + 60
    height = _TOP + _CELL * len(rows) + 20
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        f'width="{width}" height="{height}" font-family="sans-serif" font-size="11">',
        f'<title>{escape(title)}</title><rect width="100%" height="100%" fill="#fff"/>',
        f'<text x="8" y="20" font-size="14">{escape(title)}</text>',
    ]
    for j, name in enumerate(columns):
        x = _LEFT + _CELL * (j + 0.6)
        parts.append(
            f'<text x="{x:.0f}" y="{_TOP - 6}" transform="rotate(-60 {x:.0f} {_TOP - 6})">'
            f'{escape(name)}</text>'
        )
    for i, truth in enumerate(rows):
        y = _TOP + _CELL * i
        total = sum(n for (t, _), n in counts.items() if t == truth)
        parts.append(
            f'<text x="{_LEFT - 6}" y="{y + 15}" text-anchor="end">'
            f'{escape(truth)} ({total})</text>'
        )
        for j, answer in enumerate(columns):
            n = counts.get((truth, answer), 0)
            part = n / total
            hue = '22,110,60' if truth == answer else '190,40,30'
            fill = f'rgba({hue},{0.12 + 0.88 * part:.2f})' if n else '#f4f4f4'
            x = _LEFT + _CELL * j
            parts.append(
                f'<rect x="{x}" y="{y}" width="{_CELL - 1}" height="{_CELL - 1}" fill="{fill}">'
                f'<title>{escape(truth)} answered as {escape(answer)}: {n}</title></rect>'
            )
            if n:
                ink = '#fff' if part > 0.5 else '#000'
                parts.append(
                    f'<text x="{x + 10}" y="{y + 15}" text-anchor="middle" fill="{ink}">{n}</text>'
                )
    parts.append('</svg>')
    return '\n'.join(parts)


def _order(name: str) -> tuple[int, str]:
    return {'nothing': 1, 'unknown': 2}.get(name, 0), name
