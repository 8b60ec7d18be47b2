"""The check by an added mass: which slip makes which ratio, in closed form, and 20 seeded benches with each slip."""

import random
from dataclasses import replace
from pathlib import Path

import pytest

from haptic_fieldbus.api.identification import BenchTask, bounds_of, identify
from haptic_fieldbus.drive.rig import Identified, Rig
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.identification.estimates import Estimate, ScaleCheck, scale_check
from haptic_fieldbus.planning.known_bench import digest_with
from haptic_fieldbus.protocols.catalogue import load_rig
from tests.api.test_identification import GEARED, LINEAR, rig_text


def check(ratio: float, gear: float | None = None, half: float = 0.02) -> ScaleCheck:
    """A check of 4e-5 kg·m² that was measured `ratio` times as large, beside a bench of 5e-5 kg·m²."""
    added = 4e-5 * ratio
    spread = half * added / 2.0**0.5
    before, after = 5e-5, 5e-5 + added
    return scale_check(
        Estimate(before, before - spread, before + spread, "kg·m²"),
        Estimate(after, after - spread, after + spread, "kg·m²"), 4e-5, gear,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("ratio", "gear", "words"),
    [
        (0.25, None, "encoder_counts_per_revolution states lines"),
        (0.25, 4.0, "encoder_counts_per_revolution states lines"),
        (4.0, None, "four times too large"),
        (1e3, None, "states mN·m for N·m"),
        (1e-3, 4.0, "thousand times too small"),
        (256.0, 4.0, "the wrong way round; it is 0.25"),
        (1.0 / 256.0, 0.25, "the wrong way round; it is 4"),
        (16.0, 4.0, "states a gear that is not between motor and handle"),
        (1.0 / 49.0, 1.0, "leaves out a gear; it is 7"),
        (1.25, None, "the motor gives 0.8 times the stated torque"),
    ],
)
def test_a_slip_is_named_by_its_factor(ratio: float, gear: float | None, words: str) -> None:
    found = check(ratio, gear)
    assert not found.is_right
    assert words in found.text()
    assert found.to_json()["ratio"] == pytest.approx(ratio)


@pytest.mark.parametrize(("torque", "gear"), [(1.0 / 0.7, None), (0.5, None), (1.5, None), (9.0, 3.0), (49.0, 7.0)])
def test_a_direct_drive_is_told_the_torque_and_a_gear_only_where_there_are_such_gears(
    torque: float, gear: float | None
) -> None:
    """A motor that gives `torque` times the stated one is beside a gear with the root of it; gears begin at 2."""
    text = check(1.0 / torque, 1.0).text()
    assert "the motor gives" in text
    assert ("leaves out a gear" in text) == (gear is not None)
    assert gear is None or f"leaves out a gear; it is {gear:g}" in text


@pytest.mark.parametrize("gear", [None, 1.0, 4.0])
def test_a_rig_that_agrees_with_the_mass_is_told_so(gear: float | None) -> None:
    found = check(1.04, gear)
    assert found.is_right
    assert found.text().endswith("torque, gear and counts of the rig agree with it")
    assert (found.ratio.value, found.ratio.half_width) == pytest.approx((1.04, 0.02 * 1.04), rel=1e-6)


def test_a_mass_that_is_lost_in_the_intervals_tells_nothing() -> None:
    found = check(1.0, half=0.5)
    assert not found.is_right
    assert "add a larger one" in found.text()
    assert found.to_json()["ratio"] is None


def test_a_mass_that_is_not_on_the_handle_is_not_called_too_small() -> None:
    """The bench is measured to 0.1 % both times, so that a mass of its own weight would be seen."""
    bench = Estimate(5e-5, 4.995e-5, 5.005e-5, "kg·m²")
    text = scale_check(bench, bench, 4e-5, None).text()
    assert text == "the added mass was not seen; check that it is fixed to the handle"


# Whole benches.


def texts(slip: str, seed: int) -> tuple[str, str, dict[str, float], str]:
    """A rig with a slip, the same with an inertia added to the handle, the option, and the words that name it."""
    draw = random.Random(f"{slip} {seed}")
    inertia, counts = 4e-5 * 2.0 ** draw.uniform(-1.0, 1.0), draw.choice((1024, 4096, 20_000))
    added = inertia * draw.uniform(0.4, 1.5)
    ratio, handle, words = 0.05 / 6.283185307179586, LINEAR, "agree with it"
    true = [f"viscous_damping = {2e-4 * 2.0 ** draw.uniform(-1.0, 1.0)!r}"]
    if slip == "lines":
        true.append(f"encoder_counts_per_revolution = {4 * counts}")
        words = "states lines"
    elif slip == "gear":
        # The gear of the rig is the wrong way round, or it leaves out a gear of four.
        stated = draw.choice((1.0, 0.25))
        ratio, words = 1.0 / 4.0, "leaves out a gear; it is 4" if stated == 1.0 else "the wrong way round; it is 4"
        handle = (f'{{ kind = "rotary", gear_ratio = {stated} }}', "[-6.0, 6.0]" if stated == 1.0 else "[-24.0, 24.0]")
    elif slip == "mN·m":
        true.append("torque_scale = 0.001")
        words = "states mN·m for N·m"
    named = {"with_mass" if handle is LINEAR else "with_inertia": added / ratio**2}
    both = (rig_text(*true, f"inertia = {each!r}", counts=counts, handle=handle) for each in (inertia, inertia + added))
    before, after = (_in_millinewton(each) if slip == "mN·m" else each for each in both)
    return before, after, named, words


def _in_millinewton(text: str) -> str:
    """The rated torque stated in mN·m, by a person who is sure of it; what follows from it is stated so too."""
    text = text.replace("rated_torque = 0.4", 'rated_torque = 400.0\ni_know = ["rated_torque", "inertia"]')
    for key, value in (("inertia", 4e-5), ("viscous_damping", 3e-4), ("coulomb_friction", 2e-3)):
        text = text.replace(f"\n{key} = {value:.1e}", f"\n{key} = {1e3 * value!r}", 1)
    return text.replace(
        "[axis.handle.simulation]",
        "[axis.handle.permissions]\nsign_effort = 8000.0\n\n[axis.handle.simulation]\ncoulomb_friction = 2.0e-3",
    )


@pytest.mark.thorough("measures 20 benches twice for each slip")
@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("slip", ["lines", "gear", "mN·m", "none"])
def test_a_slip_of_a_bench_is_named(tmp_path: Path, slip: str, seed: int) -> None:
    before, after, named, words = texts(slip, seed)
    rig = tmp_path / "rig.toml"
    rig.write_text(before, encoding="utf-8")
    identify(BenchTask(rig))
    table = rig.read_text(encoding="utf-8").removeprefix(before)
    rig.write_text(after + table, encoding="utf-8")
    found = identify(BenchTask(rig, **named))  # type: ignore[arg-type]
    assert found.scale is not None
    assert words in found.scale.text()
    assert found.written == ""
    assert rig.read_text(encoding="utf-8") == after + table


@pytest.mark.parametrize(
    ("handle", "words", "complaint"),
    [
        (LINEAR, {"with_inertia": 1e-4}, "expected --with-mass alone, in kg: axis handle is linear"),
        (GEARED, {"with_mass": 0.1}, "expected --with-inertia alone, in kg·m²"),
        (LINEAR, {"with_mass": 0.1, "with_inertia": 1e-4}, "expected --with-mass alone"),
        (LINEAR, {"with_mass": -0.1}, "expected a finite number above 0"),
        (LINEAR, {"with_mass": float("inf")}, "expected a finite number above 0"),
        (LINEAR, {"with_mass": 0.1}, "no valid measurement without the mass; run identify without it first"),
    ],
)
def test_a_mass_that_tells_nothing_is_refused(
    tmp_path: Path, handle: tuple[str, str], words: dict[str, float], complaint: str
) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text(rig_text(handle=handle), encoding="utf-8")
    with pytest.raises(UsageError, match=complaint):
        bounds_of(BenchTask(rig, **words))  # type: ignore[arg-type]


IDENTIFIED = Identified(
    inertia=4e-5, inertia_interval=(3.9e-5, 4.1e-5), viscous_damping=1e-4, viscous_damping_interval=(9e-5, 1.1e-4),
    coulomb_friction=2e-3, coulomb_friction_interval=(1.9e-3, 2.1e-3),
)  # fmt: skip


def sealed_rig(tmp_path: Path, **conditions: object) -> Rig:
    """A rig on a simulated bus, with a table whose digest is right."""
    rig = tmp_path / "rig.toml"
    rig.write_text(rig_text(), encoding="utf-8")
    told = load_rig(rig)
    axis, kept = told.axis["handle"], replace(IDENTIFIED, **conditions)  # type: ignore[arg-type]
    sealed = replace(axis, identified=replace(kept, digest=digest_with(axis, kept)))
    return replace(told, axis={"handle": sealed})


@pytest.mark.parametrize(
    ("conditions", "bus", "complaint"),
    [
        ({"simulated": True}, "socketcan:can0", r"\(the values of \[identified\] were measured on a simulated bus\)"),
        ({"axis": "other"}, None, "were measured on the axis other"),
        ({"profile": "elmo_gold"}, None, "were measured with the profile elmo_gold"),
    ],
)
def test_a_measurement_that_counts_for_no_plan_is_compared_with_no_mass(
    tmp_path: Path, conditions: dict[str, object], bus: str | None, complaint: str
) -> None:
    own = sealed_rig(tmp_path, simulated=True, axis="handle", profile="maxon_epos4")
    assert bounds_of(BenchTask(own, with_mass=0.1)).axis == "handle"
    with pytest.raises(UsageError, match=f"--with-mass: the rig has no valid measurement.*{complaint}"):
        bounds_of(BenchTask(sealed_rig(tmp_path, **conditions), with_mass=0.1, bus=bus))


def test_a_table_of_an_earlier_version_that_two_axes_share_is_compared_with_no_mass(tmp_path: Path) -> None:
    alone = sealed_rig(tmp_path)
    copied = replace(alone, axis=alone.axis | {"copy": replace(alone.axis["handle"], node=6)})
    assert bounds_of(BenchTask(alone, with_mass=0.1)).axis == "handle"
    with pytest.raises(UsageError, match="is that of the axis copy too"):
        bounds_of(BenchTask(copied, axis="handle", with_mass=0.1))
