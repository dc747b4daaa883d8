"""Tables of text: CSV, tabs, semicolons, blanks, LabVIEW; decimal point or comma."""

from __future__ import annotations

import codecs
import contextlib
import csv
import re
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from datetime import date, datetime, time, timedelta
from pathlib import Path

import numpy as np

from impactscope.errors import RecordingError

from .column_table import HEADING_MARKS, ColumnFile

__all__ = ['read_text']

_MOST_OF_A_HEAD = 20  # lines of several numbers in a header
_LAST = 100  # lines that tell how a file is laid out
_LAST_ROWS = 10  # of them, in which no column of text holds a number
_DELIMITERS = (',', ';', '\t', '|')
_CONTROL = re.compile(rb'[\x00-\x08\x0e-\x1f\x7f]')  # no text has them
# date and time of day, or a time of day with its seconds
_STAMP = re.compile(r'\s*(\d{4}-\d\d-\d\d[T ]\d\d:\d\d|\d\d:\d\d:\d\d)')
_DAY, _HALF_A_DAY = timedelta(days=1), timedelta(hours=12)
_DATE_END = re.compile(r'(?<=\d{4}-\d\d-\d\d) (?=\d\d:\d\d)')
_DATE_LIKE = re.compile(r'\s*\d{1,4}[-./:]\d')
_NO_DATE = 'neither a number nor a date and time such as 2025-11-14 20:07:10.53'
_RULE = '-=_+|*~# \t'  # of which a line below headings is drawn
_REMARK = ('', 'comment', 'comments')  # headings of columns that most rows end before


@dataclass(frozen=True, slots=True)
class _Layout:
    """How the rows of a table are told from its header.

    Most rows have ``width`` columns. ``stamped`` of them hold dates and times; ``loose`` ones may
    hold text: those that do in most rows, and those that are empty in the last ones.
    """

    width: int
    stamped: frozenset[int]
    loose: frozenset[int]

    def is_row(self, fields: Sequence[str]) -> bool:
        """Whether these are as many numbers, dates and times, and texts as in a row."""
        firm = ['' if j in self.loose else text for j, text in enumerate(fields)]
        return len(fields) == self.width and _numeric(firm, self.stamped)

    def begins_a_row(self, fields: Sequence[str]) -> bool:
        """Whether these are as many as in a row, and the first that is to be a number is one."""
        firm = [j for j in range(self.width) if j not in self.loose]
        return (
            len(fields) >= self.width
            and bool(firm)
            and _is_number(fields[firm[0]], firm[0] in self.stamped)
        )


@dataclass(slots=True)
class _Rows:
    """Rows on their way to numbers."""

    path: Path
    layout: _Layout
    names: tuple[str, ...]
    padding: list[float]  # NaN for the columns that headings name and most rows do not have
    origins: dict[int, datetime] = field(default_factory=dict)  # first date and time of a column
    texts: dict[int, str] = field(default_factory=dict)  # what stands in columns of text

    def numbers(self, fields: list[str], number: int) -> list[float]:
        """Values of a row on line ``number``; NaN where it is empty or text.

        Raises RecordingError where it has other columns than the table or no number in one.
        """
        if len(fields) == self.layout.width and not self.layout.stamped:
            with contextlib.suppress(ValueError):  # for speed: most rows are plain
                return [_number(text) for text in fields] + self.padding
        while len(fields) > self.layout.width and not fields[-1].strip():
            fields.pop()
        surplus = fields[self.layout.width :]
        names = self.names[self.layout.width :]
        odd = len(surplus) > len(names) or any(
            _is_number(text, dated=False) and name.lower() not in _REMARK
            for text, name in zip(surplus, names, strict=False)
        )
        if odd or len(fields) < self.layout.width:
            raise RecordingError(
                f'{self.path.name!r}, line {number}: {len(fields)} columns instead of '
                f'{self.layout.width}'
            )
        found = [self._value(j, text, number) for j, text in enumerate(fields)]
        return found + [np.nan] * (self.layout.width + len(self.padding) - len(fields))

    def _value(self, j: int, text: str, number: int) -> float:
        stamped = j in self.layout.stamped
        try:
            return _seconds(text, j, self.origins) if stamped else _number(text)
        except ValueError:
            if j in self.layout.loose or j >= self.layout.width:
                self.texts.setdefault(j, _told(text, number))
                return np.nan
            kind = 'date and time' if stamped else 'number'
            raise RecordingError(
                f'{self.path.name!r}, line {number}, column {j}: {text[:40]!r} is no {kind}'
            ) from None
        except TypeError:  # of the difference
            raise RecordingError(
                f'{self.path.name!r}, line {number}, column {j}: {text[:40]!r} and '
                f'{self.origins[j].isoformat()!r} further up: one has a time zone, one has none'
            ) from None


def _told(text: str, number: int) -> str:
    """What a column of text holds, by its first one, on line ``number``."""
    told = f'text such as {text.strip()[:40]!r} in line {number}'
    return f'{told}, {_NO_DATE}' if _DATE_LIKE.match(text) else told


def _number(text: str) -> float:
    """A field of a row; NaN where it is empty. A comma that is left in it is a decimal one."""
    text = text.strip()
    return float(text.replace(',', '.', 1)) if text else np.nan


def _seconds(text: str, j: int, first: dict[int, datetime]) -> float:
    """A date and time in column j as s from the first one there; NaN where it is empty.

    A time of day alone that lies more than half a day before the first is one of the day after.
    """
    text = text.strip()
    if not text:
        return np.nan
    of_a_day = text[2:3] == ':'
    if of_a_day:
        stamp = datetime.combine(date.min, time.fromisoformat(text))
    else:
        stamp = datetime.fromisoformat(text)
    origin = first.setdefault(j, stamp)
    if (origin.date() == date.min) != of_a_day:
        raise ValueError(text)
    since = stamp - origin
    return (since + _DAY if of_a_day and since < -_HALF_A_DAY else since).total_seconds()


def _stamped(fields: list[str]) -> frozenset[int]:
    """Columns in which a date and time stands."""
    return frozenset(j for j, text in enumerate(fields) if _STAMP.match(text))


def _is_number(text: str, dated: bool) -> bool:
    """Whether a field holds a number, or where it is ``dated`` a date and time."""
    try:
        _seconds(text, 0, {}) if dated else _number(text)
    except ValueError:
        return False
    return bool(text.strip())


def _count(fields: Sequence[str], stamped: Collection[int] = ()) -> int:
    """How many of these are numbers, or dates and times in the columns ``stamped``."""
    return sum(_is_number(text, j in stamped) for j, text in enumerate(fields))


def _numeric(fields: Sequence[str], stamped: Collection[int] = ()) -> bool:
    """Whether these are numbers, beside dates and times in the columns ``stamped``."""
    filled = sum(bool(text.strip()) for text in fields)
    return 0 < filled == _count(fields, stamped)


def _delimiter_of(tail: list[str]) -> str | None:
    """What parts the fields of these lines; a comma beside another delimiter is a decimal one."""
    text = ''.join(tail)
    others = [d for d in _DELIMITERS if d != ',' and d in text]
    if ',' in text and others:
        by_other, by_comma = (
            [_split(line, delimiter) for line in tail] for delimiter in (others[0], ',')
        )
        better = sum(
            _numeric(theirs, _stamped(theirs))
            or 0 < _count(theirs, _stamped(theirs)) >= _count(own, _stamped(own))
            for theirs, own in zip(by_other, by_comma, strict=True)
        )
        if 2 * better >= len(tail):  # headings may be among a short file's last lines
            return others[0]
    return ',' if ',' in text else next(iter(others), None)


def _split(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    return next(csv.reader([line], delimiter=delimiter), [])


def _text_of(path: Path) -> str:
    """Text of a file: UTF-8, UTF-16 with its mark, else one byte a character.

    Numbers are the same in all of the last kind; headings may then read oddly.
    """
    content = path.read_bytes()
    with contextlib.suppress(UnicodeDecodeError):
        return content.decode('utf-8-sig')
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        with contextlib.suppress(UnicodeDecodeError):
            text = content.decode('utf-16')
            if any(c in '0123456789' for c in text):
                return text
    elif not _CONTROL.search(content):
        return content.decode('latin-1')
    raise RecordingError(f'{path.name!r} is neither text, NumPy, MATLAB nor JSON')


def _layout(tail: list[list[str]], delimiter: str | None) -> _Layout:
    """Layout of a table from its last lines, each as its fields; headings may be among them.

    Only where a ``delimiter`` parts the fields may they be text: blanks part words, too.
    """
    # A header may hold numbers as well: the data are as wide as most of the last lines.
    widths = Counter(len(fields) for fields in tail).most_common(1)
    width = widths[0][0] if widths else 0
    alike = [fields for fields in tail if len(fields) == width]
    stamps = Counter(_stamped(fields) for fields in reversed(alike)).most_common(1)
    stamped = stamps[0][0] if stamps else frozenset()
    rows = [fields for fields in alike if _count(fields, stamped)]
    loose = set()
    for j in range(width):
        told = [_is_number(row[j], j in stamped) for row in rows if row[j].strip()]
        # names stand before numbers in headers, too: the last rows decide
        wordy = not any(told[-_LAST_ROWS:]) and 2 * sum(told) < len(told)
        if not told or (wordy and delimiter is not None):
            loose.add(j)
    return _Layout(width, stamped, frozenset(loose))


def _first_row(lines: list[str], delimiter: str | None, layout: _Layout) -> tuple[int, int]:
    """Where the data begins, and from where on it is sure to be data; the end if nowhere.

    What begins with a number right below the headings is data, too, whatever else is in it: it
    is to be read or refused, not to be lost.
    """
    sure = next(
        (i for i, line in enumerate(lines) if layout.is_row(_split(line, delimiter))), len(lines)
    )
    if sure == len(lines):
        return sure, sure
    first = sure
    while first and layout.begins_a_row(_split(lines[first - 1], delimiter)):
        first -= 1
    above = _split(lines[first - 1], delimiter) if first else []
    headed = len(above) >= layout.width and not _count(above, layout.stamped)
    return (first if headed else sure), sure


def read_text(path: Path, skip_rows: int | None, delimiter: str | None) -> ColumnFile:
    """Read a table of text, of which the last lines tell the layout.

    Args:
        path: of the file.
        skip_rows: lines of its header; None: up to the first row.
        delimiter: None: found from the last lines; blanks where none is there.

    Raises RecordingError where it is no table.
    """
    lines = _text_of(path).splitlines()
    tail = [line for line in lines[skip_rows or 0 :][-_LAST:] if line.strip()]
    if delimiter is None:
        delimiter = _delimiter_of(tail[-10:])
    if delimiter is None:  # the blank inside a date and time parts no columns
        lines, tail = ([_DATE_END.sub('T', line) for line in part] for part in (lines, tail))
    ends = [_split(line, delimiter) for line in tail]
    layout = _layout(ends, delimiter)
    first, sure = skip_rows, 0
    if first is None:
        first, sure = _first_row(lines, delimiter, layout)
        _refuse_ragged(path, lines[:first], first, delimiter)
    numbered = [(i, line) for i, line in enumerate(lines[first:], first + 1) if line.strip()]
    if not numbered or len(layout.loose) == layout.width:
        raise RecordingError(
            f'{path.name!r} has no rows of numbers after {first} header lines'
            f'{_odd(ends, layout.stamped)}'
        )
    widest = len(_split(numbered[0][1], delimiter))
    names = _headings(lines[:first], delimiter, layout, widest)
    rows = _Rows(path, layout, names, [np.nan] * (len(names) - layout.width))
    table = np.empty((len(numbered), layout.width + len(rows.padding)))
    for k, (number, line) in enumerate(numbered):
        try:
            table[k] = rows.numbers(_split(line, delimiter), number)
        except RecordingError as error:
            if number > sure:
                raise
            raise RecordingError(
                f'{error}; if that line is of the header, skip {sure} lines (--skip-rows)'
            ) from error
    texts = {j: rows.texts[j] for j in sorted(rows.texts)}
    table[:, list(texts)] = np.nan
    return ColumnFile(
        path, {'': table}, names, numbered[0][0], stamped=layout.stamped, texts=texts
    )


def _headings(
    head: list[str], delimiter: str | None, layout: _Layout, widest: int
) -> tuple[str, ...]:
    """Names of the columns, without the mark of a comment before them; () where there are none.

    They stand in the last line that neither is a row nor begins as one, else in the last that is
    none, but for a rule drawn below them. They may be more than most rows have columns: those of
    remarks, and ``widest``, as many as the first row has.
    """
    written = [x for x in head if x.strip(_RULE)]
    no_rows = [x for x in written if not layout.is_row(_split(x, delimiter))]
    plain = [x for x in no_rows if not layout.begins_a_row(_split(x, delimiter))]
    for line in (*plain[-1:], *no_rows[-1:]):
        for text in (line, line.lstrip(HEADING_MARKS)):
            names = _names(text, delimiter, layout.width, widest)
            if names:
                return (names[0].lstrip(HEADING_MARKS) or names[0], *names[1:])
    return ()


def _names(line: str, delimiter: str | None, width: int, widest: int) -> list[str]:
    """Headings in a line, at least ``width``; none where it has not as many, or numbers."""
    names = [name.strip() for name in _split(line, delimiter)]
    if delimiter is not None:
        while len(names) > width and not names[-1]:
            names.pop()
    surplus = names[width:] if delimiter is not None else []
    remarks = len(names) == widest or all(name.lower() in _REMARK for name in surplus)
    good = len(names) - len(surplus) == width and remarks and not _numeric(names)
    return names if good else []


def _odd(ends: list[list[str]], stamped: frozenset[int]) -> str:
    """What stands in a file's last line instead of a number."""
    for j, text in enumerate(ends[-1] if ends else ()):
        if text.strip() and not _is_number(text, j in stamped):
            return f': column {j} of the last line is {text[:40]!r}, {_NO_DATE}'
    return ''


def _refuse_ragged(path: Path, head: list[str], first: int, delimiter: str | None) -> None:
    """Refuse a head that is a table itself: columns of different length side by side."""
    wide = [
        (i, len(fields))
        for i, fields in enumerate((_split(line, delimiter) for line in head), 1)
        if len(fields) > 1 and _numeric(fields, _stamped(fields))
    ]
    if len(wide) > _MOST_OF_A_HEAD:
        raise RecordingError(
            f'{path.name!r}: lines {wide[0][0]} to {wide[-1][0]} are rows of {wide[0][1]} '
            f'numbers, those from line {first + 1} on have another number of columns; cut all '
            'columns to one length, or say how many lines to skip'
        )
