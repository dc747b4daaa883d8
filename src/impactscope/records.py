"""The records that pass between stages: immutable, SI units, integer nanoseconds, no ROS.

Each mirrors the message of the same name in ``msg/``, field by field; the conversion stands in
:mod:`impactscope.nodes.conversions`. Sample arrays are float32, as in the messages, so that
a stage gives the same numbers in the live graph and offline, to the last bit.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = [
    'AnalysisResult',
    'Channel',
    'ComplianceVerdict',
    'Contact',
    'ContactKind',
    'Estimate',
    'EventResult',
    'ImpactEvent',
    'ImpactParameters',
    'Mode',
    'Quality',
    'SampleBlock',
    'SensorParameters',
    'SensorSummary',
    'SyncedBlock',
    'TestPoint',
    'Verdict',
    'VerdictScope',
]

NANOSECONDS = 1_000_000_000


class Quality(enum.IntFlag):
    """Flags that samples, blocks and events carry; bits as in ``msg/Quality.msg``."""

    NONE = 0
    CLIPPED = 1  # a sample at or beyond the channel's range
    GAP_BEFORE = 2  # samples were lost before or inside
    STALLED = 4  # the device delivered late
    CLOCK_JUMP = 8  # the clock was not continuous
    NOT_FINITE = 16  # NaN or inf among the recorded values
    MISSING = 32  # the channel has no samples here (values are NaN)
    TORN = 64  # the stream began or ended inside the event's window
    OVERLAPPING = 128  # another event began before this one had come to rest
    COLD_START = 256  # no quiet stretch before the blow: the noise floor is not known
    HELD = 512  # contact lasted beyond the longest hold of the measurement profile


class Verdict(enum.IntEnum):
    """The one enumeration of judgements; the worst that applies has the last word.

    The value 0, which an unset field carries, is INCOMPLETE: nothing becomes a PASS by default.
    """

    INCOMPLETE = 0
    INVALID = 1
    FAIL = 2
    CONDITIONAL_FAIL = 3
    CONDITIONAL_PASS = 4
    PASS = 5


class VerdictScope(enum.IntEnum):
    """What a verdict speaks of."""

    EVENT = 0
    TEST_POINT = 1


class ContactKind(enum.IntEnum):
    """Whether the body part can move away from the blow."""

    UNKNOWN = 0
    CONSTRAINED = 1
    FREE = 2


class Estimate(NamedTuple):
    """A value with its standard uncertainty, both in the unit of the field that holds it."""

    value: float = math.nan
    std: float = math.nan


@dataclass(frozen=True, slots=True, eq=False)
class SampleBlock:
    """Consecutive samples of one channel. ``values`` has shape (n_samples,), float32.

    A block without values marks the end of its channel's stream in this epoch.
    """

    channel: str
    unit: str
    sample_rate: float  # Hz, nominal
    stamp_ns: int  # host time of the first sample, as best known
    first_index: int  # of the first sample in this epoch; a jump is lost data
    values: NDArray[np.float32]
    epoch: int = 0  # counts activations of the device
    device_time_ns: int = -1  # first sample on the device's clock; -1 where it has none
    received_ns: int = 0  # host time at which the block was complete; 0 where unknown
    quality: Quality = Quality.NONE
    range_min: float = math.nan
    range_max: float = math.nan
    frame_id: str = ''

    @property
    def is_end(self) -> bool:
        """Whether this marks the end of the channel's stream."""
        return self.values.size == 0


@dataclass(frozen=True, slots=True)
class Channel:
    """What one channel of a synchronised block or of an event is."""

    name: str
    unit: str
    frame_id: str = ''
    native_rate: float = 0.0  # Hz at which the device sampled; 0 where unknown
    range_min: float = math.nan
    range_max: float = math.nan
    quality: Quality = Quality.NONE


@dataclass(frozen=True, slots=True, eq=False)
class SyncedBlock:
    """All channels of a bench on one grid.

    ``values`` has shape (n_channels, n_samples), float32, NaN where a channel has no data;
    row 0 is the reference channel, whose own samples stand untouched at every grid index that
    is a multiple of ``oversampling`` (counted from grid index 0 of the epoch). Zero samples
    mark the end of the stream.
    """

    stamp_ns: int  # time of the first grid sample
    sample_rate: float  # Hz, of the grid
    epoch: int
    first_index: int  # grid index of the first sample
    channels: tuple[Channel, ...]
    values: NDArray[np.float32]
    oversampling: int = 1

    @property
    def is_end(self) -> bool:
        """Whether this marks the end of the stream."""
        return bool(self.values.shape[1] == 0)


@dataclass(frozen=True, slots=True)
class Contact:
    """One span of contact; times in s after the first sample of the event's window."""

    start: float
    end: float
    peak_force: float  # N, zero level removed
    peak_time: float
    impulse: float  # N s


@dataclass(frozen=True, slots=True)
class TestPoint:
    """What is being tested. Empty strings and NaN mean: not stated."""

    id: str = ''
    body_region: str = ''
    contact: ContactKind = ContactKind.UNKNOWN
    repetition: int = 0
    repetitions_planned: int = 0
    robot: str = ''
    tool: str = ''
    pose: str = ''
    speed: float = math.nan  # m/s
    device: str = ''
    spring_stiffness: float = math.nan  # N/m
    spring_stiffness_std: float = math.nan  # N/m
    damper: str = ''
    notes: str = ''
    start_ns: int = 0
    end_ns: int = 0  # 0 while open

    def holds(self, stamp_ns: int) -> bool:
        """Whether a blow at this time belongs to the test point."""
        return self.start_ns <= stamp_ns and (self.end_ns == 0 or stamp_ns <= self.end_ns)


TestPoint.__test__ = False  # type: ignore[attr-defined]  # not a test class for pytest


@dataclass(frozen=True, slots=True, eq=False)
class ImpactEvent:
    """One blow, from the quiet before it to the rest after it.

    ``values`` has shape (n_channels, n_samples), float32; row 0 is the channel in which the
    blow was found. Times are s after the first sample of the window.
    """

    event_id: int
    stamp_ns: int  # first contact
    window_start_ns: int
    sample_rate: float
    channels: tuple[Channel, ...]
    values: NDArray[np.float32]
    contacts: tuple[Contact, ...]
    contact_start: float
    contact_end: float
    event_end: float
    zero_level: tuple[float, ...]  # per channel; NaN where not known
    noise_std: tuple[float, ...]  # per channel; NaN where not known
    rest_level: float = math.nan
    quality: Quality = Quality.NONE
    oversampling: int = 1
    test_point: TestPoint = field(default_factory=TestPoint)

    def index_of(self, name: str) -> int | None:
        """Row of a channel in ``values``, or None where the event lacks it."""
        return next((i for i, c in enumerate(self.channels) if c.name == name), None)


@dataclass(frozen=True, slots=True)
class Mode:
    """One decaying mode of several that ring after a blow; as in ``msg/Mode.msg``."""

    natural_frequency: Estimate = Estimate()  # Hz, undamped
    damping_ratio: Estimate = Estimate()
    amplitude: Estimate = Estimate()  # unit of the channel, at the span's start


@dataclass(frozen=True, slots=True)
class SensorParameters:
    """What one blow tells about the sensor; fields as in ``msg/SensorParameters.msg``."""

    event_id: int
    stamp_ns: int
    valid: bool
    reason: str = ''
    method: str = ''
    channel: str = ''
    span_start: float = math.nan  # s after the window's start
    span_end: float = math.nan
    natural_frequency: Estimate = Estimate()  # Hz
    damped_frequency: Estimate = Estimate()  # Hz
    damping_ratio: Estimate = Estimate()
    bandwidth: Estimate = Estimate()  # Hz
    stiffness: Estimate = Estimate()  # N/m
    moving_mass: Estimate = Estimate()  # kg
    damping_constant: Estimate = Estimate()  # N s/m
    amplitude: Estimate = Estimate()
    offset: Estimate = Estimate()
    r_squared: float = math.nan
    rmse: float = math.nan
    spectral_frequency: Estimate = Estimate()  # Hz
    spectral_damping_ratio: Estimate = Estimate()
    frequency_slope: Estimate = Estimate()  # Hz, change while the amplitude grows e-fold
    damping_slope: Estimate = Estimate()
    small_amplitude_frequency: Estimate = Estimate()  # Hz, natural, in the limit
    linearity_p_value: float = math.nan  # chance of such slopes in a linear oscillation
    modes: tuple[Mode, ...] = ()  # where several ring, the most energy first


@dataclass(frozen=True, slots=True)
class SensorSummary:
    """What several blows tell of the sensor together; as in ``msg/SensorSummary.msg``."""

    stamp_ns: int
    event_ids: tuple[int, ...]
    channel: str = ''
    natural_frequency: Estimate = Estimate()  # Hz
    damping_ratio: Estimate = Estimate()
    moving_mass: Estimate = Estimate()  # kg
    scatter_p_value: float = math.nan  # chance of so large a scatter on one linear sensor
    frequency_slope: Estimate = Estimate()  # Hz, between blows, while the amplitude grows e-fold
    damping_slope: Estimate = Estimate()
    linearity_p_value: float = math.nan


@dataclass(frozen=True, slots=True)
class ImpactParameters:
    """What one blow tells about impactor and contact; as in ``msg/ImpactParameters.msg``."""

    event_id: int
    stamp_ns: int
    valid: bool
    reason: str = ''
    method: str = ''
    peak_force: Estimate = Estimate()  # N, as measured
    peak_contact_force: Estimate = Estimate()  # N, reconstructed
    contact_time: Estimate = Estimate()  # s, first contact
    impulse: Estimate = Estimate()  # N s, first contact
    impact_speed: Estimate = Estimate()  # m/s
    effective_mass: Estimate = Estimate()  # kg
    transferred_energy: Estimate = Estimate()  # J
    coupled_frequency: Estimate = Estimate()  # Hz, of an impactor that stays on the plate
    coupled_mass: Estimate = Estimate()  # kg, from that frequency


@dataclass(frozen=True, slots=True)
class ComplianceVerdict:
    """Judgement of one blow or of a test point; as in ``msg/ComplianceVerdict.msg``."""

    stamp_ns: int
    verdict: Verdict
    scope: VerdictScope
    event_ids: tuple[int, ...]
    reasons: tuple[str, ...]
    test_point: TestPoint
    limit_set: str = ''
    measurement_profile: str = ''
    decision_rule: str = ''
    transient_force: Estimate = Estimate()  # N
    transient_limit: float = math.nan  # N
    quasi_static_force: Estimate = Estimate()  # N
    quasi_static_limit: float = math.nan  # N
    guard_band: float = math.nan  # N
    spread: float = math.nan  # N
    reconstructed_peak_force: float = math.nan  # N


@dataclass(frozen=True, slots=True)
class EventResult:
    """Everything the stages say of one blow."""

    event: ImpactEvent
    sensor: SensorParameters
    impact: ImpactParameters
    verdict: ComplianceVerdict


@dataclass(frozen=True, slots=True)
class AnalysisResult:
    """What an analysis of one recording gives; the input of the report."""

    source: str  # file name, without folders
    sha256: str  # of the raw recording; empty where it was not hashed
    software_version: str
    parameters: dict[str, dict[str, object]]  # stage name -> parameter -> value
    channels: tuple[Channel, ...]  # quality: all flags seen in the recording
    duration: float  # s, of the reference channel
    events: tuple[EventResult, ...]
    test_points: tuple[ComplianceVerdict, ...]  # verdicts over all repetitions
    verdict: Verdict  # of the recording as a whole
    notes: tuple[str, ...]  # what a reader must know of the data's quality, in sentences
    damaged: bool = False  # the recording could not be read to its end
    provenance: dict[str, str] = field(default_factory=dict)  # metadata of the recording
    sensor: SensorSummary | None = None  # of all blows that tell the sensor; None where none does
