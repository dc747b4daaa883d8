"""Files of columns (CSV and other text, NumPy, MATLAB, JSON) as named columns of numbers."""

from __future__ import annotations

import codecs
import contextlib
import csv
import dataclasses
import json
import re
import zipfile
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
from numpy.typing import NDArray

from impactscope.errors import (
    ImpactscopeError,
    InputError,
    MissingChannelError,
    RecordingError,
)
from impactscope.recordings.units import to_si

__all__ = ['ColumnFile', 'describe', 'read_columns']

_MOST_OF_A_HEAD = 20  # lines of several numbers in a header
_MOST_ELEMENTS = 200  # of an array of structures or cells
MOST_LISTED = 100  # columns of a lying table that are named one by one
_DELIMITERS = (',', ';', '\t', '|')
_NUMPY_MAGIC, _ZIP_MAGIC, _HDF5_MAGIC = b'\x93NUMPY', b'PK\x03\x04', b'\x89HDF'
_MATLAB_MAGIC = b'MATLAB 5.0 MAT-file'
_OLE_MAGIC = b'\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1'  # Office before 2007
_CONTROL = re.compile(rb'[\x00-\x08\x0e-\x1f\x7f]')  # no text has them
_STAMP = re.compile(r'\s*\d{4}-\d\d-\d\d[T ]\d\d:\d\d')  # date and time of day
_DATE_END = re.compile(r'(?<=\d{4}-\d\d-\d\d) (?=\d\d:\d\d)')
_HEADING_MARKS = '#% '  # before the headings of programs that take them for a comment


@dataclass(frozen=True, slots=True, eq=False)
class ColumnFile:
    """The columns of one file.

    ``arrays`` holds tables of shape (n_rows, n_columns) by name; text, .npy and JSON files have
    one, named ''. ``names`` are the headings of that one, where it has any.
    """

    path: Path
    arrays: dict[str, NDArray[np.float64]]
    names: tuple[str, ...] = ()
    first_row: int = 1  # line of the file on which the data begins
    passed_over: tuple[str, ...] = ()  # variables that are no tables, and what they are
    stamped: frozenset[int] = frozenset()  # columns of dates and times, as s from their first

    def column(self, key: str | int) -> NDArray[np.float64]:
        """One column, shape (n_rows,).

        Args:
            key: index, heading, variable (``structure.field`` in a structure), or variable and
            index as in ``data[2]``.

        Raises MissingChannelError where it is not there.
        """
        name, index = '', self._place(key)
        if isinstance(index, str):
            if index in self.arrays:
                name, index = index, 0
            else:
                name, _, rest = index.rpartition('[')
                index = int(rest[:-1]) if rest[:-1].isdecimal() and rest[-1:] == ']' else -1
        table = self.arrays.get(name)
        if table is None and isinstance(key, int) and len(self.arrays) == 1:
            table = next(iter(self.arrays.values()))
        if table is None or not 0 <= int(index) < table.shape[1]:
            raise MissingChannelError(
                f'{self.path.name!r} has no column {key!r}; it has {", ".join(self.keys())}'
            )
        if isinstance(key, str) and key == name and table.shape[1] > 1:
            raise MissingChannelError(
                f'{key!r} in {self.path.name!r} has {table.shape[1]} columns: '
                f"name one, as in '{key}[0]'"
            )
        return table[:, int(index)]

    def seconds(self, key: str | int, unit: str) -> NDArray[np.float64]:
        """A column of times in s, shape (n_rows,), of which ``unit`` is said.

        Raises MissingChannelError where it is not there, InputError where it holds dates and
        times, which are read in s, and another unit is said.
        """
        factor = to_si(unit)[1]
        if factor != 1.0 and self._place(key) in self.stamped:
            raise InputError(
                f'column {key!r} of {self.path.name!r} holds dates and times, which are read '
                f'in s; its unit is said to be {unit!r}'
            )
        return self.column(key) * factor

    def _place(self, key: str | int) -> str | int:
        """Index of a heading, with or without the mark before it; another key as it is."""
        if isinstance(key, str):
            for name in (key, key.lstrip(_HEADING_MARKS) or key):
                if name in self.names:
                    return self.names.index(name)
        return key

    def keys(self) -> list[str]:
        """What :meth:`column` takes, and how many rows each has."""
        found = []
        for name, table in self.arrays.items():
            rows, columns = table.shape
            if columns > MOST_LISTED and columns > rows:
                found.append(
                    f'{name or "the table"}: {columns} columns of {rows} rows; '
                    f'transposed {rows} columns of {columns}'
                )
                continue
            for i in range(columns):
                if name:
                    label = name if columns == 1 else f'{name}[{i}]'
                else:
                    label = f'{i} {self.names[i]!r}' if i < len(self.names) else str(i)
                dated = ', dates and times as s from the first' if i in self.stamped else ''
                found.append(f'{label} ({rows} rows{dated})')
        return found


def _table(array: NDArray[np.generic], path: Path, name: str) -> NDArray[np.float64]:
    if array.dtype.kind not in 'biuf' or array.ndim > 2:
        raise RecordingError(
            f'{name or "the array"!r} of {path.name!r} has {array.ndim} dimensions of '
            f'{array.dtype}; a table of real numbers is needed'
        )
    table = np.asarray(array, dtype=np.float64)
    return table if table.ndim == 2 else table.reshape(-1, 1)


def _number(field: str) -> float:
    """A field of a row; NaN where it is empty. A comma that is left in it is a decimal one."""
    text = field.strip()
    return float(text.replace(',', '.', 1)) if text else np.nan


def _seconds(field: str, j: int, first: dict[int, datetime]) -> float:
    """A date and time in column j as s from the first one there; NaN where it is empty."""
    text = field.strip()
    if not text:
        return np.nan
    stamp = datetime.fromisoformat(text)
    return (stamp - first.setdefault(j, stamp)).total_seconds()


def _stamped(fields: list[str]) -> frozenset[int]:
    """Columns in which a date and time stands."""
    return frozenset(j for j, field in enumerate(fields) if _STAMP.match(field))


def _numeric(fields: list[str], stamped: Collection[int] = ()) -> bool:
    """Whether these are numbers, beside dates and times in the columns ``stamped``."""
    try:
        found = [
            _seconds(f, j, {}) if j in stamped else _number(f)
            for j, f in enumerate(fields)
            if f.strip()
        ]
    except ValueError:
        return False
    return bool(found)


def _delimiter_of(tail: list[str]) -> str | None:
    """What parts the fields of these lines; a comma beside another delimiter is a decimal one."""
    text = ''.join(tail)
    others = [d for d in _DELIMITERS if d != ',' and d in text]
    if ',' in text and others:
        rows = [_split(line, others[0]) for line in tail]
        numeric = sum(_numeric(fields, _stamped(fields)) for fields in rows)
        if 2 * numeric >= len(tail):  # headings may be among a short file's last lines
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


def _read_text(path: Path, skip_rows: int | None, delimiter: str | None) -> ColumnFile:
    lines = _text_of(path).splitlines()
    tail = [line for line in lines[skip_rows or 0 :][-100:] if line.strip()]
    if delimiter is None:
        delimiter = _delimiter_of(tail[-10:])
    if delimiter is None:  # the blank inside a date and time parts no columns
        lines, tail = ([_DATE_END.sub('T', line) for line in part] for part in (lines, tail))
    ends = [_split(line, delimiter) for line in tail]
    # A header may hold numbers as well: the data are as wide as most of the last lines.
    widths = Counter(len(fields) for fields in ends).most_common(1)
    alike = [fields for fields in ends if len(fields) == widths[0][0]]
    stamps = Counter(_stamped(fields) for fields in reversed(alike)).most_common(1)
    stamped = stamps[0][0] if stamps else frozenset()
    first = skip_rows
    if first is None:
        first = len(lines)
        for i, line in enumerate(lines):
            fields = _split(line, delimiter)
            if _numeric(fields, stamped) and len(fields) == widths[0][0]:
                first = i
                break
        _refuse_ragged(path, lines[:first], first, delimiter)
    rows = [(i, line) for i, line in enumerate(lines[first:], first + 1) if line.strip()]
    if not rows:
        raise RecordingError(
            f'{path.name!r} has no rows of numbers after {first} header lines{_odd(ends, stamped)}'
        )
    width = len(_split(rows[0][1], delimiter))
    table = np.empty((len(rows), width))
    origins: dict[int, datetime] = {}
    for k, (number, line) in enumerate(rows):
        fields = _split(line, delimiter)
        if len(fields) != width:
            raise RecordingError(
                f'{path.name!r}, line {number}: {len(fields)} columns instead of {width}'
            )
        for j, field in enumerate(fields):
            try:
                table[k, j] = _seconds(field, j, origins) if j in stamped else _number(field)
            except ValueError:
                kind = 'date and time' if j in stamped else 'number'
                raise RecordingError(
                    f'{path.name!r}, line {number}, column {j}: {field[:40]!r} is no {kind}'
                ) from None
            except TypeError:  # of the difference
                raise RecordingError(
                    f'{path.name!r}, line {number}, column {j}: {field[:40]!r} and '
                    f'{origins[j].isoformat()!r} further up: one has a time zone, one has none'
                ) from None
    names = _headings(lines[first - 1], width, delimiter) if first else ()
    return ColumnFile(path, {'': table}, names, rows[0][0], stamped=stamped)


def _headings(line: str, width: int, delimiter: str | None) -> tuple[str, ...]:
    """Names of the columns, without the mark of a comment before them; () where it has none."""
    for text in (line, line.lstrip(_HEADING_MARKS)):
        names = [field.strip() for field in _split(text, delimiter)]
        if len(names) == width and not _numeric(names):
            return (names[0].lstrip(_HEADING_MARKS) or names[0], *names[1:])
    return ()


def _odd(ends: list[list[str]], stamped: frozenset[int]) -> str:
    """What stands in a file's last line instead of a number."""
    for j, field in enumerate(ends[-1] if ends else ()):
        if field.strip() and not _numeric([field], {0} if j in stamped else ()):
            return (
                f': column {j} of the last line is {field[:40]!r}, neither a number nor a date '
                'and time such as 2025-11-14 20:07:10.53'
            )
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


def _read_json(path: Path) -> ColumnFile:
    content = json.loads(path.read_text(encoding='utf-8'))
    if isinstance(content, list):
        content = {'': content}
    if not isinstance(content, dict):
        raise RecordingError(f'{path.name!r} holds no table')
    arrays = {}
    for name, value in content.items():
        array = np.array(value) if isinstance(value, list) else None
        if array is not None and array.dtype.kind in 'biuf':
            arrays[str(name)] = _table(array, path, str(name))
    if not arrays:
        raise RecordingError(f'{path.name!r} holds no table of numbers')
    return ColumnFile(path, arrays)


def _matlab_variables(name: str, value: Any) -> Iterator[tuple[str, NDArray[np.generic] | str]]:
    """Numeric arrays of a variable, or what it is instead.

    Those inside structures as ``structure.field``; of arrays of structures by the ``Name`` that
    each has or by its number, as ``array.name.field`` or ``array{2}.field``; of cells as
    ``cell{2}``.
    """
    if isinstance(value, scipy.io.matlab.MatlabOpaque) or not isinstance(value, np.ndarray):
        yield name, 'an object, which only MATLAB can read'
    elif value.dtype.names is not None:
        elements = value.ravel()[:_MOST_ELEMENTS]
        titles = [_title(element) for element in elements]
        named = all(titles) and len(set(titles)) == len(titles) > 1
        for k, element in enumerate(elements):
            own = '' if value.size == 1 else f'.{titles[k]}' if named else f'{{{k}}}'
            for field in value.dtype.names:
                yield from _matlab_variables(f'{name}{own}.{field}', element[field])
    elif value.dtype.kind == 'O':
        for k, element in enumerate(value.ravel()[:_MOST_ELEMENTS]):
            yield from _matlab_variables(f'{name}{{{k}}}' if value.size > 1 else name, element)
    elif value.dtype.kind in 'biuf' and value.ndim <= 2:
        yield name, value
    elif value.dtype.kind not in 'US':  # text names things
        yield name, f'{value.ndim} dimensions of {value.dtype}'


def _title(element: Any) -> str:
    """What a structure calls itself, as the measuring systems of dSPACE do; empty if nothing."""
    told = element['Name'] if 'Name' in element.dtype.names else None
    text = np.asarray(told).ravel() if told is not None else np.zeros(0)
    return str(text[0]).strip('"\' ') if text.size == 1 and text.dtype.kind in 'US' else ''


def _read_matlab(path: Path) -> ColumnFile:
    arrays, passed_over = {}, []
    for variable, content in scipy.io.loadmat(str(path)).items():
        if variable.startswith('__'):
            continue
        for name, array in _matlab_variables(
            'an object' if variable == 'None' else variable, content
        ):
            if isinstance(array, str):
                passed_over.append(f'{name} ({array})')
            elif array.size:
                # MATLAB's vectors are tables of one row or one column.
                lying = array.ndim == 2 and array.shape[0] == 1
                arrays[name] = _table(array.T if lying else array, path, name)
    if not arrays:
        what = f': {", ".join(passed_over)}' if passed_over else ''
        raise RecordingError(f'{path.name!r} holds no numeric variables{what}')
    return ColumnFile(path, arrays, passed_over=tuple(passed_over))


def read_columns(
    path: str | Path,
    *,
    skip_rows: int | None = None,
    delimiter: str | None = None,
    transpose: bool = False,
) -> ColumnFile:
    """Read a file of columns, of a kind that its content tells.

    Args:
        path: text (CSV and the like), .npy, .npz, MATLAB up to version 7.2, or JSON. Columns of
            dates and times in text are read as seconds from the first.
        skip_rows: header lines of a text file; None: up to the first line of as many numbers as
            most lines have.
        delimiter: of a text file; None: found from the last lines; blanks where none is there.
        transpose: whether the rows of the file's tables are the channels.

    Raises RecordingError where it is missing, of another kind, or not a table of numbers.
    """
    path = Path(path)
    try:
        with path.open('rb') as file:
            head = file.read(32)
    except OSError as error:
        raise RecordingError(f'{str(path)!r} cannot be read: {error.strerror}') from error
    if not head:
        raise RecordingError(f'{path.name!r} is empty (0 bytes)')
    try:
        found = _parse(path, head, skip_rows, delimiter)
    except ImpactscopeError:
        raise
    except Exception as error:  # whatever the formats' readers raise on hostile bytes
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RecordingError(f'{path.name!r} cannot be read as a table ({reason})') from error
    return _transposed(found) if transpose else found


def _parse(path: Path, head: bytes, skip_rows: int | None, delimiter: str | None) -> ColumnFile:
    if head.startswith(_NUMPY_MAGIC):
        return ColumnFile(path, {'': _table(np.load(path, allow_pickle=False), path, '')})
    if head.startswith(_ZIP_MAGIC):
        return _read_archive(path)
    if head.startswith(_OLE_MAGIC):
        raise RecordingError(
            f'{path.name!r} is an Excel workbook (.xls) or another Office file: save it as CSV'
        )
    if head.startswith(_MATLAB_MAGIC):
        return _read_matlab(path)
    if head.startswith((_HDF5_MAGIC, b'MATLAB 7.3')):
        raise RecordingError(
            f'{path.name!r} is a MATLAB 7.3 (HDF5) file: save it anew with `save -v7`'
        )
    if head.lstrip()[:1] in (b'{', b'['):
        return _read_json(path)
    return _read_text(path, skip_rows, delimiter)


def _read_archive(path: Path) -> ColumnFile:
    with zipfile.ZipFile(path) as content:
        members = content.namelist()
    for part, kind in (('xl/', 'an Excel'), ('content.xml', 'an OpenDocument')):
        if any(member.startswith(part) for member in members):
            raise RecordingError(f'{path.name!r} is {kind} workbook: save its sheet as CSV')
    arrays = {}
    with np.load(path, allow_pickle=False) as archive:
        for name in archive.files:
            array = archive[name]
            if not isinstance(array, np.ndarray):
                raise RecordingError(
                    f'{path.name!r} is a ZIP archive and {name!r} in it no NumPy array: unpack it'
                )
            arrays[name] = _table(array, path, name)
    return ColumnFile(path, arrays)


def _transposed(file: ColumnFile) -> ColumnFile:
    """Tables of more than one column with rows for channels."""
    arrays = {n: t.T if t.shape[1] > 1 else t for n, t in file.arrays.items()}
    return dataclasses.replace(file, arrays=arrays, stamped=frozenset())


def describe(
    path: str | Path,
    *,
    skip_rows: int | None = None,
    delimiter: str | None = None,
    transpose: bool = False,
) -> list[str]:
    """The columns of a file, one line each: what to name them, and how many rows they have.

    Takes and raises what :func:`read_columns` does.
    """
    file = read_columns(path, skip_rows=skip_rows, delimiter=delimiter, transpose=transpose)
    return [*file.keys(), *(f'passed over: {told}' for told in file.passed_over)]
