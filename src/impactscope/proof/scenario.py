"""A whole campaign before it is measured: the truth of every blow and of every channel."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from .axis import Law
from .bench import Bench, Pendulum, Pulse
from .given_course import Wave
from .noise import WHITE, Colour
from .trajectories import Move

__all__ = ['STRIKES', 'Blow', 'Chain', 'Scenario', 'Sensor', 'impactor']

STRIKES = ('pendulum', 'robot', 'drop')  # kinds of blow in which an impactor strikes


class Chain(NamedTuple):
    """What stands between a quantity and its samples, in this order; 0 is absent.

    Low pass, resonance, AC coupling, gain, curvature, drift, offset, hum,
    (noise,) saturation, quantisation.
    """

    gain: float = 1.0
    cutoff: float = 0.0  # Hz, Butterworth low pass
    order: int = 2
    zero_phase: bool = False  # forwards and backwards: the order counts twice
    corner: float = 0.0  # Hz, high pass of first order
    drift: float = 0.0  # unit of the channel per s
    offset: float = 0.0  # unit of the channel
    hum: float = 0.0  # amplitude, unit of the channel
    hum_frequency: float = 50.0  # Hz
    limit: float = 0.0  # unit of the channel
    step: float = 0.0  # unit of the channel
    clock_offset: float = 0.0  # s: a sample stamped t was taken at t + offset + drift t
    clock_drift: float = 0.0
    # outside the library
    curvature: float = 0.0  # 1 over the unit of the channel: v + curvature v |v|
    resonance: float = 0.0  # share of the signal that passes a resonance first
    resonance_frequency: float = 300.0  # Hz


class Sensor(NamedTuple):
    """What the campaign file states of the sensor."""

    stiffness: float = 69e3  # N/m
    stiffness_std: float = 500.0


@dataclass(frozen=True)
class Blow:
    """One recording: what happens in it, and what the campaign file says of it."""

    kind: str  # 'tap', one of STRIKES, 'driven', 'closed_loop', 'prescribed' or 'chain'
    bench: Bench
    start: float  # s from the begin of the recording to first contact
    duration: float  # s, of the recording
    role: str = 'fit'
    pulses: tuple[Pulse, ...] = ()  # times after ``start``
    distance: float = 0.0  # m, of the movable mass, as labelled
    angle_deg: float = 0.0  # release, as labelled
    labelled_mass: float = 0.0  # kg, of a robot or a falling body
    labelled_speed: float = 0.0  # m/s, likewise
    distance_error: float = 0.0  # m, true minus labelled
    angle_error_deg: float = 0.0  # true minus labelled: scatter, or a wrong label
    fall: float = 0.0  # s, from release to first contact
    hum_phase: float = 0.0  # rad
    waves: tuple[Wave, ...] = ()  # the given course, times from the begin of the recording
    moves: tuple[Move, ...] = ()  # of the reference of an axis, likewise
    law: Law = Law()
    led_by: Blow | None = None  # the recording whose commanded force acts on this axis
    begin: tuple[float, float] = (0.0, 0.0)  # m, m/s: where it begins, beside that recording

    @property
    def excited_until(self) -> float:
        """End of the forces of unknown course, s after ``start``; 0 where none acts."""
        if self.kind != 'tap':
            return 0.0
        return max((pulse.start + pulse.duration for pulse in self.pulses), default=0.0)


@dataclass(frozen=True)
class Scenario:
    """A campaign: conditions, truth, channels and their noise."""

    kind: str  # 'impact', 'driven', 'closed_loop', 'prescribed' or 'chain'
    orientation: str
    blows: tuple[Blow, ...]
    rates: Mapping[str, float]  # Hz by channel
    noise: Mapping[str, float]  # standard deviation by channel, before its converter
    chains: Mapping[str, Chain]
    baseline: tuple[str, ...]
    sensor: Sensor = Sensor()
    layer: Mapping[str, float] | None = None  # layer_stiffness, branch_stiffness, branch_damping
    pendulum: Pendulum = Pendulum()
    angle_std_deg: float = 0.1
    gain_std: Mapping[str, float] = field(default_factory=dict)  # by channel
    stated_axis: Mapping[str, float] | None = None  # its mass and damping; None: to be estimated
    colours: Mapping[str, Colour] = field(default_factory=dict)  # of the noise; absent: white

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the recorded responses."""
        return tuple(self.rates)

    def colour(self, channel: str) -> Colour:
        """Colour of a channel's noise."""
        return self.colours.get(channel, WHITE)

    def all_fitted(self) -> Scenario:
        """The same campaign with no recording held out."""
        return replace(self, blows=tuple(replace(b, role='fit') for b in self.blows))

    def led_by(self, truth: Scenario) -> Scenario:
        """The same axis under the forces that are recorded in another campaign."""
        blows = tuple(
            replace(mine, led_by=theirs)
            for mine, theirs in zip(self.blows, truth.blows, strict=True)
        )
        return replace(self, blows=blows)

    def with_bench(self, change: Callable[[Blow], Mapping[str, float]]) -> Scenario:
        """The same campaign with fields of every bench changed."""
        blows = tuple(replace(b, bench=b.bench._replace(**change(b))) for b in self.blows)
        return replace(self, blows=blows)

    def with_chain(self, channel: str, **change: float) -> Scenario:
        """The same campaign with the chain of one channel changed."""
        chains = dict(self.chains)
        chains[channel] = chains[channel]._replace(**change)  # type: ignore[arg-type]
        return replace(self, chains=chains)

    def with_pendulum(self, pendulum: Pendulum) -> Scenario:
        """The same campaign struck with another pendulum: mass, speed and weight follow."""
        return replace(self, pendulum=pendulum).with_bench(
            lambda blow: impactor(pendulum, blow, self.orientation, blow.bench)
        )


def impactor(
    pendulum: Pendulum, blow: Blow, orientation: str, bench: Bench
) -> Mapping[str, float]:
    """Fields of the bench that follow from the pendulum and the true conditions of a blow."""
    if blow.kind != 'pendulum':
        return {}
    distance = blow.distance + blow.distance_error
    angle = blow.angle_deg + blow.angle_error_deg
    return {
        'impactor_mass': pendulum.effective_mass(distance),
        'speed': pendulum.speed(distance, angle, orientation),
        'gravity_load': pendulum.weight_at_contact(distance) if bench.gravity_load else 0.0,
    }
