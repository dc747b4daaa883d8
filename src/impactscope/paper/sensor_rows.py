"""Section 3.1.1 of the paper: the sensor, as identified from hammer taps and a spring test."""

from __future__ import annotations

import math

import numpy as np

from impactscope.estimate.stiffness_test import analyse_compression, moving_mass
from impactscope.paper import published
from impactscope.paper.recordings import TAP_FORCES, spring_test, tap
from impactscope.paper.row import Basis, PaperRow, row
from impactscope.physics.sensor_model import PAPER_SENSOR, SensorModel, bandwidth_ratio
from impactscope.records import Estimate

__all__ = ['sensor_rows']

_FRICTION = 1.0  # N of dry friction in the guide: 1 to 4 % of the first swing of a gentle tap
_TWO_PI = 2 * math.pi


def sensor_rows() -> list[PaperRow]:
    """Free oscillation, spectrum, spring, mass, Bode diagram, bandwidth and time constants."""
    return [*_modal_rows(), *_fit_rows(), *_spring_rows(), *_response_rows()]


def _modal_rows() -> list[PaperRow]:
    wn, zeta = published.NATURAL_ANGULAR_FREQUENCY, published.DAMPING_RATIO
    wd = wn * math.sqrt(1 - zeta**2)
    taps = [tap(peak) for peak in TAP_FORCES]
    frequencies = np.array([t.free.fit.natural_frequency.value for t in taps])
    ratios = np.array([t.free.fit.damping_ratio.value for t in taps])
    mean = float(_TWO_PI * frequencies.mean())
    simulated = Basis.SIMULATED
    u_ratio = taps[0].free.fit.damping_ratio.std
    return [
        row(
            '3.1.1:repetitions',
            'hammer taps',
            '1',
            '5',
            len(taps),
            'five repetitions are announced, then "a total of three tests" is averaged',
            basis=Basis.GIVEN,
        ),
        row(
            '3.1.1:omega_n',
            'natural angular frequency ω_n, mean over the taps',
            'rad/s',
            '203.2',
            mean,
            'estimated from five taps of a plate with the published constants',
            basis=simulated,
        ),
        row(
            '3.1.1:zeta',
            'damping ratio ζ, mean over the taps',
            '1',
            '0.0692',
            float(ratios.mean()),
            f'estimated from the same taps; ± {2 * u_ratio:.4f} (95 %) from the gentlest alone',
            basis=simulated,
            tolerance=0.5e-4 + 2 * u_ratio,
        ),
        row('3.1.1:zeta_rounded', 'damping ratio, rounded', '1', '0.07', zeta),
        row(
            '3.1.1:f_n',
            'natural frequency f_n = ω_n/(2π)',
            'Hz',
            '32.37',
            wn / _TWO_PI,
            f'203.2 rad/s are {wn / _TWO_PI:.2f} Hz; 32.37 Hz would be '
            f'{32.37 * _TWO_PI:.1f} rad/s',
        ),
        row(
            '3.1.1:omega_d',
            'damped angular frequency ω_d = ω_n √(1 - ζ²)',
            'rad/s',
            '202.0',
            wd,
            f'202.0 would need ζ = {math.sqrt(1 - (202.0 / wn) ** 2):.3f}',
        ),
        row(
            '3.1.1:f_d',
            'damped frequency f_d = ω_d/(2π)',
            'Hz',
            '32.15',
            wd / _TWO_PI,
            f'follows from the printed ω_d = 202.0 rad/s, not from ω_n and ζ; with f_n = '
            f'32.37 Hz it would need ζ = {math.sqrt(1 - (32.15 / 32.37) ** 2):.3f}',
        ),
        row(
            '3.1.1:sigma_percent',
            'standard deviation of ω_n over the taps',
            '%',
            '0.5',
            float(100 * frequencies.std(ddof=1) / frequencies.mean()),
            'a linear plate read with 0.4 N of noise scatters far less: the 0.5 % is not noise '
            'of the force channel but a plate, or a blow, that changes',
            basis=simulated,
            comparable=False,
        ),
    ]


def _fit_rows() -> list[PaperRow]:
    gentle = tap(TAP_FORCES[0])
    fit = gentle.free.fit
    soft, hard = tap(TAP_FORCES[0], _FRICTION), tap(300.0, _FRICTION)
    spread = 1.14 / math.sqrt(1 - 0.953)
    spectrum = gentle.spectrum
    rows = [
        row(
            '3.1.1:r_squared',
            'R² of eq. 26',
            '1',
            '0.953',
            fit.r_squared,
            f'a tap of {TAP_FORCES[0]:.0f} N on a linear plate read with 0.4 N of noise',
            basis=Basis.SIMULATED,
            comparable=False,
        ),
        row(
            '3.1.1:rmse',
            'RMSE of eq. 26',
            'N',
            '1.14',
            fit.rmse,
            'only the noise is left; the 1.14 N of the paper is noise or missing physics, and '
            'R² cannot tell which',
            basis=Basis.SIMULATED,
            comparable=False,
        ),
        row(
            '3.1.1:implied_spread',
            'standard deviation of the fitted force that R² and RMSE imply',
            'N',
            '',
            spread,
            'RMSE/√(1 - R²): of a gentle tap',
        ),
    ]
    for key, recording, words in (('soft', soft, TAP_FORCES[0]), ('hard', hard, 300.0)):
        found = recording.free.fit
        bias = 100 * (found.damping_ratio.value / published.DAMPING_RATIO - 1)
        rows += [
            row(
                f'3.1.1:friction_r_squared_{key}',
                f'R² of eq. 26, {_FRICTION:g} N of dry friction in the guide, tap {words:.0f} N',
                '1',
                '0.953',
                found.r_squared,
                f'above the praised value although the model is wrong; RMSE {found.rmse:.2f} N',
                basis=Basis.SIMULATED,
                comparable=False,
            ),
            row(
                f'3.1.1:friction_zeta_{key}',
                'ζ by that fit',
                '1',
                '0.0692',
                found.damping_ratio.value,
                f'wrong by {bias:+.0f} %, and it depends on how hard the plate is hit',
                basis=Basis.SIMULATED,
                comparable=False,
            ),
        ]
    floor = 1 / spectrum.resolution
    rows += [
        row(
            '3.1.1:fft_frequency',
            'natural frequency by FFT',
            'Hz',
            '32.85',
            spectrum.frequency.value,
            f'peak of the spectrum of {floor:.2f} s: ± {2 * spectrum.frequency.std:.2f} Hz '
            f'(95 %), resolution {spectrum.resolution:.2f} Hz. A peak above f_n is no property '
            'of a damped oscillation; 0.5 Hz is within the resolution of a record below 2 s',
            basis=Basis.SIMULATED,
            comparable=False,
        ),
        row(
            '3.1.1:fft_zeta',
            'damping ratio by half power',
            '1',
            '0.07',
            spectrum.damping_ratio.value,
            f'± {2 * spectrum.damping_ratio.std:.3f} (95 %), width of the record taken out',
            basis=Basis.SIMULATED,
        ),
    ]
    return rows


def _spring_rows() -> list[PaperRow]:
    test = spring_test()
    single = analyse_compression(test.displacement, test.force)
    cycled = spring_test(5)
    cyclic = analyse_compression(cycled.displacement, cycled.force)
    wn, k = published.NATURAL_ANGULAR_FREQUENCY, published.SPRING_STIFFNESS
    stiffness = single.stiffness
    mass = moving_mass(stiffness, Estimate(wn / _TWO_PI, 0.005 * wn / _TWO_PI))
    return [
        row(
            '3.1.1:spring_rate',
            'speed of the compression test',
            'mm/min',
            '1',
            published.SPRING_TEST_SPEED * 6e4,
            basis=Basis.GIVEN,
        ),
        row(
            '3.1.1:spring_compression',
            'spring constant by the compression test',
            'N/mm',
            '69',
            stiffness.value / 1e3,
            f'± {2 * stiffness.std / 1e3:.1f} N/mm (95 %), of that test on a spring of 69 N/mm; '
            'linearity error '
            f'{100 * single.linearity_error:.2f} %',
            basis=Basis.SIMULATED,
        ),
        row(
            '3.1.1:spring_cyclic',
            'spring constant by the cyclic test',
            'N/mm',
            '69',
            cyclic.stiffness.value / 1e3,
            f'five cycles; hysteresis {100 * cyclic.hysteresis:.2f} % of the force range, which '
            'is the noise',
            basis=Basis.SIMULATED,
        ),
        row(
            '3.1.1:spring_against_nominal',
            'measured over nominal spring constant',
            '1',
            '',
            k / 75e3,
            f'with 75 N/mm the mass would come out {100 * (75e3 / k - 1):.1f} % too large',
        ),
        row('3.1.1:mass', 'mass of the moving plate k/ω_n²', 'kg', '1.67', k / wn**2),
        row(
            '3.1.1:mass_uncertainty',
            'its standard uncertainty',
            'kg',
            '',
            mass.std,
            'the 0.5 % of ω_n count twice; stiffness as by the simulated compression test',
        ),
        row(
            '3.1.1:damping_constant',
            'damping constant c = 2 ζ ω_n m',
            'N s/m',
            '',
            PAPER_SENSOR.damping_constant,
        ),
    ]


def _response_rows() -> list[PaperRow]:
    fn, zeta = published.BANDWIDTH_FREQUENCY, published.BANDWIDTH_DAMPING
    by_frequency = SensorModel.from_modal(fn, zeta, published.SPRING_STIFFNESS)
    sensor = PAPER_SENSOR
    tau = 2 / 203
    return [
        row(
            'Fig. 8:peak_frequency',
            'peak of the Bode magnitude, f_n √(1 - 2ζ²)',
            'Hz',
            '32.1',
            sensor.resonance_frequency,
            f'from ω_n = 203.2 rad/s; from f_n = 32.37 Hz, ζ = 0.07 it is '
            f'{by_frequency.resonance_frequency:.2f} Hz; 32.1 as read off a plot, perhaps',
        ),
        row(
            'Fig. 8:peak_height',
            'height of that peak',
            'dB',
            '',
            20 * math.log10(sensor.resonance_peak),
            f'a factor of {sensor.resonance_peak:.1f}',
        ),
        row(
            '3.1.1:bandwidth',
            'bandwidth by eq. 28, ζ = 0.07',
            'Hz',
            '50.12',
            fn * bandwidth_ratio(zeta),
            f'with 32.37 Hz; ω_n = 203.2 rad/s and ζ = 0.0692 give {sensor.bandwidth:.2f} Hz',
        ),
        row(
            '3.1.1:bandwidth_critical',
            'bandwidth by eq. 28, ζ = 1',
            'Hz',
            '20.83',
            fn * bandwidth_ratio(1.0),
        ),
        row(
            '3.1.1:tau',
            'time constant τ = 2/ω_n',
            's',
            '0.01',
            tau,
            'printed as 2/203 Hz: 203 is rad/s. It is the sum of the two time constants that a '
            'sensor with ζ = 1 has',
        ),
        row(
            '3.1.1:decay_time',
            'time in which the free oscillation falls to 1/e, 1/(ζ ω_n)',
            's',
            '0.01',
            sensor.decay_time,
            f'what the reading takes to settle: {sensor.decay_time / tau:.0f} times τ',
        ),
    ]
