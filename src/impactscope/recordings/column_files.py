"""Files of columns (CSV and other text, NumPy, MATLAB, JSON) as named columns of numbers."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
from numpy.typing import NDArray

from impactscope.errors import ImpactscopeError, RecordingError

from .column_table import ColumnFile, as_table
from .text_columns import read_text

__all__ = ['ColumnFile', 'describe', 'read_columns']

_MOST_ELEMENTS = 200  # of an array of structures or cells
_NUMPY_MAGIC, _ZIP_MAGIC, _HDF5_MAGIC = b'\x93NUMPY', b'PK\x03\x04', b'\x89HDF'
_MATLAB_MAGIC = b'MATLAB 5.0 MAT-file'
_OLE_MAGIC = b'\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1'  # Office before 2007


def _json_variables(name: str, value: Any) -> Iterator[tuple[str, NDArray[np.generic] | str]]:
    """Arrays of numbers of a JSON value, or what it is instead.

    Those inside objects as ``object.key``; a list of objects as one column for each of their
    keys, with NaN where an object lacks it.
    """
    if isinstance(value, dict):
        for key, part in value.items():
            yield from _json_variables(f'{name}.{key}' if name else str(key), part)
    elif isinstance(value, list) and _of_objects(value):
        rows = [part or {} for part in value]
        for key in dict.fromkeys(key for row in rows for key in row):
            column = [row.get(key) for row in rows]
            yield from _json_variables(f'{name}.{key}' if name else str(key), column)
    elif isinstance(value, list):
        yield name, _numbers(value)


def _of_objects(value: list[Any]) -> bool:
    """Whether a list holds objects, or null in place of some."""
    return any(isinstance(part, dict) for part in value) and all(
        part is None or isinstance(part, dict) for part in value
    )


def _numbers(value: list[Any]) -> NDArray[np.generic] | str:
    """A list of numbers or of such lists, NaN in place of null; or what it is instead."""
    try:
        array = np.array(_without_null(value))
    except ValueError:
        return 'lists of different length'
    if array.dtype.kind in 'biuf':
        return array if array.ndim <= 2 else f'{array.ndim} dimensions of {array.dtype}'
    text = next((part for part in value if isinstance(part, str)), None)
    return 'no numbers' if text is None else f'text such as {text[:40]!r}'


def _without_null(value: list[Any]) -> list[Any]:
    """A list, or a list of lists, with NaN in place of null."""
    return [
        _without_null(part) if isinstance(part, list) else np.nan if part is None else part
        for part in value
    ]


def _read_json(path: Path) -> ColumnFile:
    content = json.loads(path.read_text(encoding='utf-8'))
    found = list(_json_variables('', content))
    arrays = {name: as_table(a, path, name) for name, a in found if not isinstance(a, str)}
    passed_over = tuple(
        f'{name or "the list"} ({told})' for name, told in found if isinstance(told, str)
    )
    if not arrays:
        what = f': {", ".join(passed_over)}' if passed_over else ''
        raise RecordingError(f'{path.name!r} holds no table of numbers{what}')
    if isinstance(content, list) and '' not in arrays:
        return _one_table(path, arrays, passed_over)
    return ColumnFile(path, arrays, passed_over=passed_over)


def _one_table(
    path: Path, arrays: dict[str, NDArray[np.float64]], passed_over: tuple[str, ...]
) -> ColumnFile:
    """Columns of as many rows each as a table with headings."""
    names = [
        name if table.shape[1] == 1 else f'{name}[{j}]'
        for name, table in arrays.items()
        for j in range(table.shape[1])
    ]
    table = np.hstack(list(arrays.values()))
    return ColumnFile(path, {'': table}, tuple(names), passed_over=passed_over)


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
                arrays[name] = as_table(array.T if lying else array, path, name)
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
    return found.transposed() if transpose else found


def _parse(path: Path, head: bytes, skip_rows: int | None, delimiter: str | None) -> ColumnFile:
    if head.startswith(_NUMPY_MAGIC):
        return ColumnFile(path, {'': as_table(np.load(path, allow_pickle=False), path, '')})
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
    return read_text(path, skip_rows, delimiter)


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
            arrays[name] = as_table(array, path, name)
    return ColumnFile(path, arrays)


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
    return [*file.keys(), *(f'passed over: {told}' for told in file.left_out())]
