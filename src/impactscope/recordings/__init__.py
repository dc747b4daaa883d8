"""Recordings: read MCAP and rosbag2, sound or torn; write MCAP; convert other files."""

from .batch import Damage
from .column_files import ColumnFile, describe, read_columns
from .column_mapping import ColumnMapping, ColumnSpec, time_and_unit
from .convert import Conversion, convert
from .info import AttachmentInfo, Reading, RecordingInfo, TopicInfo, file_sha256
from .reader import RawMessage, Recording, open_recording
from .sample_run import COLUMNS, SAMPLE_TYPES, SampleRun
from .streams import read_streams
from .units import UNITS, to_si
from .writer import Delivery, RecordingWriter

__all__ = [
    'COLUMNS',
    'SAMPLE_TYPES',
    'UNITS',
    'AttachmentInfo',
    'ColumnFile',
    'ColumnMapping',
    'ColumnSpec',
    'Conversion',
    'Damage',
    'Delivery',
    'RawMessage',
    'Reading',
    'Recording',
    'RecordingInfo',
    'RecordingWriter',
    'SampleRun',
    'TopicInfo',
    'convert',
    'describe',
    'file_sha256',
    'open_recording',
    'read_columns',
    'read_streams',
    'time_and_unit',
    'to_si',
]
