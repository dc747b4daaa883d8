"""From the blocks of many channels, each with its own rate, phase and clock, to one grid."""

from impactscope.synchronise.mirror import ChannelMirror
from impactscope.synchronise.notes import quality_notes
from impactscope.synchronise.sample_assembler import SampleAssembler
from impactscope.synchronise.statistics import ChannelStatistics
from impactscope.synchronise.synchroniser import Synchroniser, SynchroniserSettings

__all__ = [
    'ChannelMirror',
    'ChannelStatistics',
    'SampleAssembler',
    'Synchroniser',
    'SynchroniserSettings',
    'quality_notes',
]
