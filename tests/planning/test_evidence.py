"""A note about a run that contradicts the rig lowers the limit, and never raises it."""

from dataclasses import replace

import pytest

from haptic_fieldbus.drive.rig import Contradicted, Rig
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.planning.known_bench import evidence_digest
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.canopen.bus import CanSection, StandInCanSection
from haptic_fieldbus.scenes.catalogue import load_scene
from tests.planning.test_known_bench import AXIS, PROFILE, limit_of, told

NOTE = Contradicted(viscous_damping=3e-5, viscous_damping_interval=(2e-5, 4e-5), date="2026-11-27")
"""The axis states 1e-4."""


def planned(note: Contradicted, bus: str = "socketcan", *, seal: bool = True, **axis: object) -> Plan:
    own = replace(AXIS, contradicted=note, **axis)  # type: ignore[arg-type]
    own = replace(own, contradicted=replace(note, digest=evidence_digest(own, note))) if seal else own
    rig = Rig({"b": CanSection(bus, "can0")}, {"handle": own}, source="rig.toml")
    return compile_plan(load_scene("wall"), rig, {"p": PROFILE}, 1000.0)


def test_the_limit_rests_on_what_was_seen() -> None:
    without, seen = limit_of(planned(Contradicted())), limit_of(planned(NOTE))
    # Half of the damping was open before; the limit is proportional to the least damping.
    assert seen == pytest.approx(without * 2e-5 / 5e-5, rel=0.03)
    (axis,) = planned(NOTE).axes
    assert axis.bench.evidence.startswith("the run of 2026-11-27 showed damping 30 µN·m·s/rad, where the rig has 0.1")


@pytest.mark.parametrize("value", [1e-6, 1e-5, 5e-5, 1e-4, 3e-4, 1.0])
@pytest.mark.parametrize("key", ["viscous_damping", "inertia"])
@pytest.mark.parametrize("width", [0.01, 0.5, 1.0])
def test_no_note_raises_a_limit_or_an_acceleration(key: str, value: float, width: float) -> None:
    note = Contradicted(**{key: value, f"{key}_interval": ((1.0 - width) * value, (1.0 + width) * value)})  # type: ignore[arg-type]
    without, noted = planned(Contradicted()), planned(note)
    assert limit_of(noted) <= limit_of(without)
    assert noted.axes[0].limits.acceleration <= without.axes[0].limits.acceleration
    assert noted.axes[0].limits.effort == without.axes[0].limits.effort


def test_a_note_counts_only_for_the_values_that_it_contradicts_and_for_its_kind_of_bus() -> None:
    without = limit_of(planned(Contradicted()))
    assert limit_of(planned(replace(NOTE, digest="of another rig"), seal=False)) == without
    assert limit_of(planned(NOTE, seal=False)) == without
    assert limit_of(planned(replace(NOTE, simulated=True))) == without
    assert limit_of(planned(NOTE, "haptic_sim")) == limit_of(planned(Contradicted(), "haptic_sim"))
    assert limit_of(planned(replace(NOTE, simulated=True), "haptic_sim")) < without
    (axis,) = planned(NOTE, viscous_damping=None).axes
    assert axis.bench.evidence == ""


def test_a_note_of_a_real_bench_counts_for_the_simulation_in_its_place() -> None:
    own = replace(AXIS, contradicted=NOTE)
    own = replace(own, contradicted=replace(NOTE, digest=evidence_digest(own, NOTE)))
    rig = Rig({"b": StandInCanSection("haptic_sim", "can0")}, {"handle": own}, source="rig.toml")
    assert limit_of(compile_plan(load_scene("wall"), rig, {"p": PROFILE}, 1000.0)) == limit_of(planned(NOTE))


def test_a_new_measurement_ends_a_note() -> None:
    (axis,) = planned(NOTE).axes
    measured = replace(axis.rig, identified=told())
    assert evidence_digest(measured, axis.rig.contradicted) != axis.rig.contradicted.digest
