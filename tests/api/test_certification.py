"""`certify` on simulated benches that their rigs describe badly, and on a bus that the rig calls real."""

import signal
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from haptic_fieldbus.api import Trial, certification, prepare_run, stability
from haptic_fieldbus.api.certification import CertifyTask, certify
from haptic_fieldbus.errors import PlanError, SafetyTripError, UnstableSceneError, UsageError
from haptic_fieldbus.identification.certificate import Tapping
from haptic_fieldbus.identification.fit import fit_shaft
from haptic_fieldbus.planning.request import Task
from tests.api.certified import certified, drawn_bench
from tests.api.test_identification import rig_text
from tests.running.guard_bench import drives_behind

SLOW = 250.0
"""A rate at which a certificate takes little computing time [Hz]."""


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    path = tmp_path / "rig.toml"
    path.write_text(drawn_bench(1).text, encoding="utf-8")
    return path


@pytest.mark.thorough("certifies 13 drawn benches")
@pytest.mark.parametrize(("rate", "seed"), [(SLOW, 1), *((None, seed) for seed in range(12))])
def test_the_onset_of_a_bench_that_its_rig_describes_badly_is_told_and_not_reached(
    bench: Path, rate: float | None, seed: int
) -> None:
    found, onset = certified(seed, bench, rate)
    assert found.onset is not None
    assert max(each.stiffness for each in found.contacts) < onset
    if found.onset.reason:
        assert found.onset.low <= onset <= found.onset.high
    else:
        assert found.onset.value == pytest.approx(onset, rel=0.1)
    # Friction stops one of them before it swings back: it tells its onset, and no damping was seen.
    assert any(each.growth is not None for each in found.contacts) == (seed != 11)
    assert (found.seen is None) == (seed == 11)
    assert (found.seen or 0.0) <= 0.8 * min(found.predicted, 1.1 * onset)


def stopping(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no run begin."""

    def stop(*_: object, **words: object) -> object:
        raise SafetyTripError("stopped by the test")

    monkeypatch.setattr(certification, "prepare_run", stop)


def test_the_effort_is_announced_and_at_most_a_fifth_of_rated_torque(
    bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []
    stopping(monkeypatch)
    with pytest.raises(SafetyTripError):
        certify(CertifyTask(Task("wall", bench, rate=SLOW)), announce=told.extend)
    text = " ".join(told)
    for part in ("10.1 N (20 % of rated torque)", "keep hands off", "80 % of the predicted onset", "nobody may touch"):
        assert part in text
    low: list[str] = []
    with pytest.raises(SafetyTripError):
        certify(CertifyTask(Task("wall", bench, rate=SLOW), share=0.05), announce=low.extend)
    assert "(5 % of the predicted onset), which is below the limit: keep hands off" in low[-1]
    narrow = bench.read_text(encoding="utf-8").replace("[axis.handle.limits]", "[axis.handle.limits]\neffort = 2.0")
    bench.write_text(narrow, encoding="utf-8")
    with pytest.raises(SafetyTripError):
        certify(CertifyTask(Task("wall", bench), by_hand=True), announce=told.extend)
    assert "at most 2 N" in " ".join(told)
    assert "you tap the handle with a finger" in " ".join(told)


@pytest.mark.parametrize("share", [0.01, 0.15, 0.8])
def test_no_stiffness_is_above_the_announced_share(bench: Path, monkeypatch: pytest.MonkeyPatch, share: float) -> None:
    tapped: list[tuple[float, str]] = []
    stopping(monkeypatch)
    with suppress(SafetyTripError):  # the smallest one is too soft for swings, and no run begins
        certify(
            CertifyTask(Task("wall", bench), share=share),
            progress=lambda stiffness, unit: tapped.append((stiffness, unit)),
        )
    onset = stability("wall", bench).stiffness_limit.stable
    assert onset is not None
    assert all(0.0 < stiffness <= share * onset for stiffness, _ in tapped)
    assert tapped


@pytest.mark.parametrize(
    ("scene", "words", "error", "complaint"),
    [
        ("wall", {"share": 0.95}, UsageError, r"--share 0\.95: expected a number above 0, up to 0\.9"),
        ("wall", {"share": 0.0}, UsageError, "expected a number above 0"),
        ("virtual_shaft", {}, PlanError, "needs the axis"),
        ("damper", {}, UsageError, "a scene of one axis with a stiffness"),
    ],
)
def test_what_cannot_be_certified_is_refused(
    bench: Path, scene: str, words: dict[str, float], error: type[Exception], complaint: str
) -> None:
    with pytest.raises(error, match=complaint):
        certify(CertifyTask(Task(scene, bench), **words))  # type: ignore[arg-type]


@pytest.mark.parametrize("scene", ["sprung_mass", "damped_sprung_mass", "free_puck"])
def test_a_mass_behind_a_spring_is_refused_because_it_gives_way(scene: str) -> None:
    with pytest.raises(UsageError, match="gives way"):
        certify(CertifyTask(Task(scene)))


@pytest.mark.parametrize("scene", ["standard_linear_solid", "virtual_coupling", "wall"])
def test_what_holds_a_push_is_tapped(scene: str, monkeypatch: pytest.MonkeyPatch) -> None:
    stopping(monkeypatch)
    with pytest.raises(SafetyTripError, match="stopped by the test"):
        certify(CertifyTask(Task(scene)))


def test_a_bench_without_a_known_limit_is_refused(bench: Path) -> None:
    text = bench.read_text(encoding="utf-8").splitlines()
    bench.write_text("\n".join(line for line in text if not line.startswith("viscous_damping")), encoding="utf-8")
    with pytest.raises(PlanError, match=r"lacks axis\.handle\.viscous_damping"):
        certify(CertifyTask(Task("wall", bench)))


def test_only_a_certificate_goes_above_the_limit_and_with_a_fifth_of_rated_torque(bench: Path) -> None:
    task = Task("wall", bench, settings={"wall.stiffness": 1e5})
    with pytest.raises(UnstableSceneError):
        prepare_run(task, Trial(hand="none"))
    session, _ = prepare_run(task, Trial(hand="none"), beyond=True)
    (axis,) = session.plan.axes
    assert axis.limits.effort == pytest.approx(0.2 * axis.rated_effort)


# A bus that the rig calls real.


@pytest.fixture
def real(bench: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A rig with a real bus, behind which simulated drives are, in virtual time."""
    text = rig_text().replace("haptic_sim", "socketcan").replace("3.0e-4", "1.0e-4")
    bench.write_text(text, encoding="utf-8")

    monkeypatch.setattr("haptic_fieldbus.api.site.site_of", drives_behind)
    return bench


def test_a_real_bench_is_asked_once_and_again_above_the_limit(real: Path) -> None:
    asked: list[str] = []
    above: list[str] = []

    def refuse(question: str) -> bool:
        above.append(question)
        return False

    def agree(question: str) -> bool:
        asked.append(question)
        return True

    found = certify(CertifyTask(Task("wall", real, rate=SLOW)), confirm=agree, above=refuse)
    assert len(asked) == 1
    assert "at most 20 % of rated torque" in asked[0]
    assert len(above) == 1
    assert "above the limit of" in above[0]
    assert "Take all hands off" in above[0]
    assert max(each.stiffness for each in found.contacts) == found.limit
    assert found.ended == "the limit, because going above it was not confirmed"
    assert found.bench["serial"] is not None
    assert found.bench["bus"] == "socketcan:bench@1000000"


def test_a_real_bench_that_is_not_confirmed_is_not_enabled(real: Path) -> None:
    with pytest.raises(UsageError, match="not enabled"):
        certify(CertifyTask(Task("wall", real, rate=SLOW)), confirm=lambda question: False)


@pytest.mark.thorough("certifies a bench")
def test_only_true_and_false_are_answers(real: Path) -> None:
    typed: Any = "n".format  # as of `input`
    with pytest.raises(TypeError, match=r"answer of confirm\(\): expected True or False"):
        certify(CertifyTask(Task("wall", real, rate=SLOW)), confirm=typed)
    with pytest.raises(TypeError, match=r"answer of confirm\(\): expected True or False"):
        certify(CertifyTask(Task("wall", real, rate=SLOW)), confirm=lambda question: True, above=typed)


@pytest.mark.thorough("certifies a bench")
def test_taps_by_hand_tell_no_onset_and_end_at_the_limit_without_a_confirmation(
    real: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("haptic_fieldbus.identification.certificate.LISTENING", 0.3)
    found = certify(CertifyTask(Task("wall", real, rate=SLOW), by_hand=True), confirm=lambda question: True)
    assert all(each.by_hand for each in found.contacts)
    assert found.onset is None


@pytest.mark.thorough("taps by hand take ten seconds each")
def test_a_bench_is_tapped_by_hand_up_to_the_limit_and_by_pulses_above_it(bench: Path) -> None:
    """The hand of the simulation taps three times while the drive listens."""
    text = bench.read_text(encoding="utf-8")
    bench.write_text(text.replace('"sim-modbus-tcp"', '"haptic_sim"').replace("generic_cia402_modbus", "maxon_epos4"))
    found = certify(CertifyTask(Task("wall", bench, rate=SLOW), by_hand=True))
    assert [each.by_hand for each in found.contacts] == [each.stiffness <= found.limit for each in found.contacts]
    assert found.contacts[0].by_hand
    assert not found.contacts[-1].by_hand
    assert any(each.growth is not None for each in found.contacts if each.by_hand), "taps are seen"
    assert not found.ended.startswith("growth"), "a tap is no growth"
    assert found.onset is not None


@pytest.mark.thorough("taps a wall at 1000 Hz in a dozen steps")
def test_a_finger_on_the_shipped_bench_is_no_growth() -> None:
    """At 1000 Hz, where a swing at the limit takes 0.18 s; the onset is twice the limit there."""
    found = certify(CertifyTask(Task("wall"), by_hand=True, share=0.5), confirm=lambda question: True)
    assert found.contacts[-1].stiffness == pytest.approx(0.5 * found.predicted, rel=0.01)
    assert found.seen == found.contacts[-1].stiffness
    assert all(each.by_hand for each in found.contacts)


# What ends a certificate.


def test_a_contact_that_grows_ends_it(bench: Path) -> None:
    """The rig states sixty times the true damping."""
    bench.write_text(rig_text("viscous_damping = 5.0e-6", "coulomb_friction = 4.0e-4"), encoding="utf-8")
    found = certify(CertifyTask(Task("wall", bench)))
    assert found.ended.startswith("growth: at ")
    assert (len(found.contacts), found.seen) == (1, None)
    assert found.contradiction.startswith("the onset is below the predicted")


def test_a_handle_that_leaves_its_travel_ends_it(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(certification, "ROOM_SHARE", 5.0)
    with pytest.raises(SafetyTripError, match=r"would have left the announced travel .* torque is off"):
        certify(CertifyTask(Task("wall", bench, rate=SLOW)))


def test_a_contact_that_holds_no_push_is_refused_before_anything_moves(
    bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The end stops behind the detents swung well damped, and were told as the detents."""
    bench.write_text(rig_text(), encoding="utf-8")
    stopping(monkeypatch)
    with pytest.raises(UsageError, match=r"holds a push of .* N; detents gives way to it"):
        certify(CertifyTask(Task("detents", bench)))


@pytest.mark.thorough("taps a contact in three steps")
def test_a_rubber_ball_is_certified_as_far_as_it_is_as_stiff_as_it_says(bench: Path) -> None:
    """Of 3600 N/m at its largest force, the press finds 2300."""
    bench.write_text(rig_text(), encoding="utf-8")
    found = certify(CertifyTask(Task("hunt_crossley", bench)))
    assert "the contact gave way to the press" in found.ended
    assert found.seen is not None
    assert 900.0 <= found.seen < 3600.0


@pytest.mark.thorough("taps two contacts")
@pytest.mark.parametrize("scene", ["end_stops", "standard_linear_solid"])
def test_a_contact_is_tapped_at_its_surface_and_may_be_soft_at_rest(
    scene: str, bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(certification, "STEP", 4.0)
    bench.write_text(rig_text(), encoding="utf-8")
    found = certify(CertifyTask(Task(scene, bench)))
    assert found.seen == found.contacts[-1].stiffness
    assert found.onset is not None
    assert found.onset.value == pytest.approx(found.predicted, rel=0.05)


def test_a_contact_whose_swings_have_too_few_counts_is_not_tapped(bench: Path) -> None:
    text = bench.read_text(encoding="utf-8")
    bench.write_text(text.replace("encoder_counts_per_revolution = ", "encoder_counts_per_revolution = 24 #"), "utf-8")
    found = certify(CertifyTask(Task("wall", bench, rate=SLOW)))
    assert found.ended.startswith("resolution")
    assert (found.seen, found.onset) == (None, None)


@pytest.mark.thorough("taps a wall in many steps")
def test_taps_that_tell_no_shaft_leave_the_onset_open(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def none(*_: object) -> object:
        return fit_shaft([])

    monkeypatch.setattr(certification, "fit_shaft", none)
    monkeypatch.setattr(certification, "STEP", 10.0)
    assert certify(CertifyTask(Task("wall", bench, rate=SLOW))).onset is None


def test_a_signal_ends_it(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def raised(self: Tapping) -> object:
        signal.raise_signal(signal.SIGINT)
        yield 0.0

    monkeypatch.setattr(Tapping, "_all", raised)
    with pytest.raises(KeyboardInterrupt):
        certify(CertifyTask(Task("wall", bench, rate=SLOW)))


def test_a_run_that_is_over_before_its_taps_is_a_trip(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(certification, "LONGEST", 0.5)
    with pytest.raises(SafetyTripError, match="the taps were ended before the last one"):
        certify(CertifyTask(Task("wall", bench, rate=SLOW)))
