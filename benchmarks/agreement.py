"""The twin against the simulator of the concealed examination, on motions known exactly.

The two share no code and may not import each other; only here do they meet. By case: the largest
difference of the twin from the exact solution and from the examination's simulator, in the
channel where it is the largest share of the quietest noise of a campaign. Two simulators
agree where that share is below a tenth.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
from numpy.typing import NDArray

from impactscope.errors import ConfigurationError
from impactscope.physics.twin import layout as at
from impactscope.physics.twin.assembly import Effect, assemble, normalise
from impactscope.physics.twin.bench import (
    Bench,
    Blow,
    DamperLayer,
    HammerTap,
    MaxwellBranch,
    RobotBlow,
    Sensor,
)
from impactscope.physics.twin.integrator import integrate
from impactscope.physics.twin.simulate import (
    CHANNELS,
    LONGEST_STEP,
    MAX_EVENTS,
    MOST_STEPS,
    SimulationError,
    sufficient_tolerance,
)
from impactscope.physics.twin.start import corners, start
from impactscope.proof.bench import BENCH
from impactscope.proof.known_cases import KNOWN_CASES, NOISE, Agreement, KnownCase, simulate

Array = NDArray[np.float64]
Channels = dict[str, Array]

AGREED = 0.1  # of the noise
COLUMNS = {name: column for name, (_, column) in CHANNELS.items()} | {
    'displacement.plate': at.PLATE_POSITION,
    'contact': at.CONTACT_FORCE,
}
HEAVIEST_PLATE, HEAVIEST_IMPACTOR = 1e6, 1e4  # kg that a description may have
_BLANK = BENCH._replace(mass=1.0, stiffness=0.0, damping=0.0)._asdict()


class Fields(dict[str, float]):
    """A case's numbers. Each is taken once, so that none is passed over in silence."""

    def take(self, name: str) -> float:
        """Value of a field, or the one it has where the case does not name it."""
        return self.pop(name, _BLANK[name])


def describe(case: KnownCase) -> tuple[Bench, Blow, tuple[Effect, ...]]:
    """Bench, blow and mechanisms of the twin for a known case; no mechanism is implied.

    Masses beyond what a description may have, which make a body immovable, are cut to that.
    Raises ConfigurationError where the twin has no words for a field or a pulse.
    """
    fields = Fields(case.description)
    sensor = Sensor(
        stiffness=fields.take('stiffness'),
        moving_mass=min(fields.take('mass'), HEAVIEST_PLATE),
        damping_constant=fields.take('damping'),
    )
    effects = [*plate_effects(fields)]
    bench = Bench(sensor=sensor, damper=layer(fields))
    blow: Blow = tap(case)
    if (mass := fields.take('impactor_mass')) > 0:
        if case.pulses:
            raise ConfigurationError('the twin has no hammer tap beside an impactor')
        speed = fields.take('speed')
        blow = RobotBlow(min(mass, HEAVIEST_IMPACTOR), speed, push_force=0.0)
        effects.append(Effect('gravity_load', {'force': fields.take('gravity_load')}))
        effects.append(Effect('unilateral_contact'))
    if fields:
        raise ConfigurationError(f'the twin has no words for {", ".join(fields)}')
    return bench, blow, normalise(effects, bench, blow)


def plate_effects(fields: Fields) -> list[Effect]:
    """Mechanisms of spring, guide and fixture."""
    effects = []
    forward, backward = fields.take('friction_forward'), fields.take('friction_backward')
    if forward == backward > 0:
        effects.append(Effect('coulomb_friction', {'force': forward}))
    elif forward != backward:
        forces = {'force_forward': forward, 'force_backward': backward}
        effects.append(Effect('asymmetric_friction', forces))
    if cubic := fields.take('cubic'):
        name = 'hardening_spring' if cubic > 0 else 'softening_spring'
        effects.append(Effect(name, {'cubic': cubic}))
    if gap := fields.take('clearance'):
        effects.append(Effect('clearance', {'gap': gap}))
    if mass := fields.take('base_mass'):
        values = {
            'mass': mass,
            'frequency': fields.take('base_frequency'),
            'damping_ratio': fields.take('base_damping'),
        }
        effects.append(Effect('base_compliance', values))
    return effects


def layer(fields: Fields) -> DamperLayer | None:
    """The damper layer; None: the case has none."""
    parallel, stiffness = fields.take('layer_stiffness'), fields.take('branch_stiffness')
    if parallel == 0:
        if stiffness:
            raise ConfigurationError('the twin has no layer of a branch without a parallel spring')
        return None
    branches = (MaxwellBranch(stiffness, fields.take('branch_damping')),) if stiffness else ()
    return DamperLayer(parallel, branches)


def tap(case: KnownCase) -> HammerTap:
    """The hammer's tap of a case, of no force where it has none."""
    if not case.pulses:
        return HammerTap(peak_force=0.0)
    (pulse, *more) = case.pulses
    if more or pulse.start != 0 or pulse.power != 1 or pulse.cycles:
        raise ConfigurationError('the twin taps once, at time 0, with a half sine')
    return HammerTap(pulse.peak, pulse.duration)


def simulate_with_twin(case: KnownCase, tolerance: float | None = None) -> Channels:
    """Samples of a known case by the twin, by channel.

    Raises ConfigurationError where the twin cannot express the case, SimulationError where it
    does not get through.
    """
    bench, blow, effects = describe(case)
    par = assemble(bench, blow, effects)
    par[at.PLATE_MASS] = case.description['mass']  # as heavy as the case says
    par[at.IMPACTOR_MASS] = case.description.get('impactor_mass', 0.0)
    state, contact = start(par)
    state[at.X] += case.displacement  # a blow begins at rest, a known case need not
    state[at.V] += case.velocity
    rows = np.zeros((len(case.times), at.N_COLUMNS))
    found, steps = integrate(
        par,
        state,
        contact,
        corners(par),
        case.times,
        sufficient_tolerance(par) if tolerance is None else tolerance,
        LONGEST_STEP,
        MOST_STEPS,
        rows,
        np.empty(MAX_EVENTS),
        np.empty(MAX_EVENTS, dtype=np.int64),
    )
    if found < 0:
        raise SimulationError(f'{case.name}: the twin gives up after {steps} steps ({found})')
    return {name: rows[:, column] for name, column in COLUMNS.items()}


def differences(case: KnownCase, ours: Channels, others: Channels) -> list[Agreement]:
    """Largest difference by channel that both have."""
    table = []
    for channel in sorted(ours.keys() & others.keys()):
        worst = float(np.max(np.abs(ours[channel] - others[channel])))
        table.append(
            Agreement(case.name, channel, worst, worst / NOISE[channel.partition('.')[0]])
        )
    return table


def compare(case: KnownCase) -> tuple[list[Agreement], list[Agreement]]:
    """The twin against the exact solution, and against the examination's simulator.

    Raises ConfigurationError where the twin cannot express the case.
    """
    twin = simulate_with_twin(case)
    exact = differences(case, twin, case.exact(case.times))
    return exact, differences(case, twin, simulate(case))


def main(argv: list[str] | None = None) -> int:
    """Print the table; 1 where a difference is not below a tenth of the noise."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--quick', action='store_true', help='no shorter run: it takes seconds')
    parser.parse_args(argv)
    print(f'{"":28s}{"to the exact solution":42s}to the examination')
    agreed, reasons = True, []
    for case in KNOWN_CASES:
        try:
            tables = compare(case)
        except ConfigurationError as error:
            reasons.append(f'{case.name}: {error}')
            continue
        cells = []
        for table in tables:
            worst = max(table, key=lambda row: row.in_noise)
            cells.append(f'{worst.in_noise:.1e}  {worst.largest:.1e} {worst.channel}')
            agreed = agreed and worst.in_noise < AGREED
        print(f'{case.name:28s}{cells[0]:42s}{cells[1]}')
    print(
        f'{len(KNOWN_CASES) - len(reasons)} of {len(KNOWN_CASES)} cases; share of the noise, '
        'largest difference in N, m/s² or m, its channel'
    )
    for reason in reasons:
        print(f'not expressible: {reason}')
    return int(not agreed)


if __name__ == '__main__':
    sys.exit(main())
