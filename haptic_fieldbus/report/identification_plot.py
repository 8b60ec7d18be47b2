"""Picture of a measured bench: its motion, the prediction error, and the response from torque to position."""

import math
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from haptic_fieldbus.assessing.result import Array
from haptic_fieldbus.identification import IdentifiedBench, interval_text
from haptic_fieldbus.identification.fit import ShaftRecord, prediction_errors, unsettled_samples
from haptic_fieldbus.identification.shaft import ShaftModel
from haptic_fieldbus.report.drawing import BLUE, GREY, ORANGE, dress, figure, name_lines, save, thin

SEGMENTS = 8
"""Number of half-overlapping segments of a record, over which spectra are averaged."""
COHERENT = 0.9
"""Least coherence of a point that is drawn."""


def plot_identified(found: IdentifiedBench, path: Path) -> None:
    """Draw a measured bench into a file; raises OSError when it cannot be written."""
    save(draw_identified(found), path)


def draw_identified(found: IdentifiedBench) -> Figure:
    """Return a figure of the motion, its prediction error, and a Bode plot against the model."""
    values, (_, used, unused) = found.fit.values, found.records
    told = [
        f"damping {interval_text(values['viscous_damping'])}, friction {interval_text(values['coulomb_friction'])}, "
        f"delay and lag {interval_text(values['delay_and_lag'])}"
    ]
    drawn = figure(9.0, 10.0, f"Inertia {interval_text(values['inertia'])}", told)
    motion, error, size, phase = drawn.subplots(4, 1, height_ratios=(1.0, 0.8, 1.0, 1.0))
    begin = 0.0
    for record, colour, label in ((used, BLUE, "used in the fit"), (unused, ORANGE, "predicted only")):
        times: Array = begin + record.period * np.arange(len(record.positions), dtype=float)
        begin = float(times[-1])
        motion.plot(*thin(times, np.array(record.positions)), color=colour, linewidth=1.2, label=label)
        error.plot(
            *thin(times[unsettled_samples(record) :], prediction_errors(found.fit.model, record)),
            color=colour,
            linewidth=0.8,
        )
    dress(motion, "motion of the motor", "", "angle [rad]")
    dress(error, "prediction error", "time [s]", "error [counts]")
    frequencies, response = measured_response(used)
    grid = np.geomspace(frequencies.min(), frequencies.max(), 200) if len(frequencies) else np.array([1.0, 10.0])
    model = modelled_response(found.fit.model, used.period, grid)
    size.set_xscale("log")
    size.set_yscale("log")
    phase.set_xscale("log")
    size.plot(grid, np.abs(model), color=GREY, linewidth=1.6, label="model")
    size.plot(frequencies, np.abs(response), ".", color=BLUE, label="measured")
    phase.plot(grid, _degrees(model), color=GREY, linewidth=1.6)
    phase.plot(frequencies, _degrees(response), ".", color=BLUE)
    dress(size, f"from torque to angle, where the coherence is above {COHERENT}", "", "angle / torque [rad/(N·m)]")
    dress(phase, "", "frequency [Hz]", "phase [degrees]")
    name_lines(drawn, [motion, size])
    return drawn


def _degrees(response: Array) -> Array:
    """Return the phase between −360° and 0°."""
    turned: Array = -np.mod(-np.degrees(np.angle(response)), 360.0)
    return turned


def measured_response(record: ShaftRecord) -> tuple[Array, Array]:
    """Return frequencies [Hz] and the response from torque to angle where torque and angle are coherent."""
    length = 2 * len(record.positions) // (SEGMENTS + 1)
    window = np.hanning(length)
    torque, angle, both = (np.zeros(length // 2 + 1, dtype) for dtype in (float, float, complex))
    for number in range(SEGMENTS):
        here = slice(number * length // 2, number * length // 2 + length)
        u, y = (np.fft.rfft(window * _straightened(np.array(each[here])))
                for each in (record.torques, record.positions))  # fmt: skip
        torque, angle, both = torque + abs(u) ** 2, angle + abs(y) ** 2, both + y * np.conj(u)
    frequencies = np.fft.rfftfreq(length, record.period)
    with np.errstate(divide="ignore", invalid="ignore"):
        coherence = np.nan_to_num(abs(both) ** 2 / (torque * angle))
        response = both / torque
    # A line of the window leaks into its neighbours; the slowest ones are the slow motion, where friction rules.
    good = (coherence > COHERENT) & (torque > 0.01 * torque.max()) & (frequencies > 3.0)
    return frequencies[good], response[good]


def _straightened(values: Array) -> Array:
    """Return values without their mean and slope."""
    times = np.arange(len(values))
    line: Array = values - np.polyval(np.polyfit(times, values, 1), times)
    return line


def modelled_response(model: ShaftModel, period: float, frequencies: Array) -> Array:
    """Return the response of the shaft without Coulomb friction, with the hold of the set-points."""
    s = 2j * math.pi * frequencies
    hold = (1.0 - np.exp(-s * period)) / (s * period)
    shaft = 1.0 / (s * (model.inertia * s + model.damping))
    response: Array = hold * np.exp(-s * model.delay) / (1.0 + s * model.lag) * shaft
    return response
