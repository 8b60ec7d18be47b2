"""A reversed encoder or motor, from the first period on: no more than a small torque, in any scene.

The largest torque is that of the simulated motor, which shares no code with the limits of the cycle.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from haptic_fieldbus import run, session
from haptic_fieldbus.drive.rig import Mechanics, Permissions, Seen, Stribeck, Weight
from haptic_fieldbus.errors import PlanError, SafetyTripError
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.planning.selection import load, select
from haptic_fieldbus.planning.sign_probe import sign_probe
from haptic_fieldbus.scenes.catalogue import scene_names
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.hand import HANDS, Hand, Piece
from tests.builders import VELOCITY_ONLY, WALL, canopen, endless_rig, plan_of, rig_of, shipped
from tests.system.sign_bench import HELD_BY, REVERSED, SMALL, rendered, unseen_plan, unseen_rig

RATES = (1000.0, 250.0, 50.0)
SCENES = sorted(scene_names())
SHIPPED = [name for name in shipped() if canopen(name).drive.usable]
ROUNDING = 1e-9
PULSES = 5.0 * 0.05 / (2.0 * math.pi) / 0.4
"""Share of rated torque of the largest pulses on the shipped bench: 5 N."""
SHARE = 0.15
METRES, WALL_AT = 0.05 / (2.0 * math.pi), 0.02
"""[m/rad] of the shipped bench; where the scene `wall` has it [m]."""
SOFT = {"end_stop.stiffness": 50.0}
"""Of the scene `constant`; stable at 50 Hz."""


@pytest.mark.thorough("every scene, held in every way", quick=4)
@pytest.mark.parametrize("hand", ["free", "held still", "held hard", "led", "led rigidly"])
@pytest.mark.parametrize("wrong", REVERSED)
@pytest.mark.parametrize("scene", SCENES)
def test_a_wrong_sign_ends_the_run_or_leaves_it_limited(scene: str, wrong: str, hand: str) -> None:
    outcome = rendered(unseen_plan(Task(scene)), HELD_BY[hand], [REVERSED[wrong]], seconds=2.0)
    assert outcome.largest <= (PULSES if outcome.plan.axes[0].workspace is Workspace.LINEAR else SHARE) + ROUNDING
    assert outcome.contradicted or outcome.limited
    # A hand on a lever that holds with 7.5 N·m/rad lets 5 % of rated torque turn the knob by less than two counts.
    hidden = ("led rigidly", "held hard") if outcome.plan.axes[0].workspace is Workspace.ROTARY else ("led rigidly",)
    if hand not in hidden:
        assert outcome.contradicted, "it can be seen"


def test_a_handle_that_was_pushed_deep_before_the_sign_was_seen_is_not_thrown_out() -> None:
    """A heavy hand on an encoder of 400 counts, which hides the motion of the pulses, lets go 40 mm inside the wall.

    The wall asks for 25 N there, twice as much as it may begin with. Unlimited, it threw the handle out at 0.95 m/s.
    """
    quickly, heavy = math.pi / 0.2, 1e5
    push = (Piece(0.0, 0.5 * heavy * 0.06 * quickly**2), Piece(0.2, 0.0))
    hand = Hand("holds it deep", push, angular_frequency=quickly, mass=heavy, damping=30.0, stiffness=1e3, release=2.5)
    rig = load(Task("wall")).rig
    coarse = replace(rig.axis["handle"], seen=Seen(), encoder_counts_per_revolution=400)
    rig = replace(rig, axis={"handle": coarse})
    with session("wall", rig, duration=3.6, hand=hand) as live:
        states = [(each.time, each.position, abs(each.effort), abs(each.given)) for each in live]
    assert max(asked for time, _, asked, _ in states if time > 2.9) > 20.0
    assert max(given for *_, given in states) <= 5.0
    assert states[-1][1] < 0.0, "it went back by itself"


@pytest.mark.thorough("every scene, held in every way", quick=2)
@pytest.mark.parametrize("hand", ["free", "held still", "led", "pushed", "knocked", "to and fro"])
@pytest.mark.parametrize("scene", SCENES)
def test_a_right_sign_is_seen_soon_whoever_holds_the_handle(scene: str, hand: str) -> None:
    outcome = rendered(unseen_plan(Task(scene)), HELD_BY[hand], seconds=0.7)
    assert outcome.error is None
    assert not outcome.limited
    # The hand on the lever of a knob is six times as heavy as the motor, and rings with it.
    lever = 0.2 if hand == "free" else 0.6
    assert outcome.seen_at <= (lever if outcome.plan.axes[0].workspace is Workspace.ROTARY else 0.1)


def test_a_hand_that_nothing_moves_hides_the_sign_and_it_is_told() -> None:
    plan = unseen_plan(Task("wall"))
    outcome = rendered(plan, HELD_BY["led rigidly"], seconds=1.0)
    assert outcome.error is None
    assert outcome.limited
    assert outcome.largest <= PULSES
    assert (outcome.cycle.axes["handle"].sign.unseen or 0) > 0


def test_a_sign_that_friction_hides_is_told_with_what_to_do() -> None:
    sticky = Mechanics(stribeck=Stribeck(torque=0.1, velocity=1.0))
    result = run("wall", rig=unseen_rig(Task("wall"), simulation=sticky), hand="none", duration=1.0)
    (warning,) = result.warnings
    assert "motor direction not confirmed" in warning
    assert "release it; friction may be larger" in warning
    assert "2.51 N" in warning


@pytest.mark.thorough("a long run")
def test_a_check_that_took_the_place_of_the_scene_for_long_is_told() -> None:
    """A hand holds the handle rigidly in a soft wall, and lets go after 0.8 s; the direction is seen after that."""
    hand = Hand("holds it", mass=1000.0, damping=1e4, stiffness=1e6, release=0.8)
    settings = {"wall.position": -0.02, "wall.stiffness": 20.0}
    (warning,) = run("wall", rig=unseen_rig(Task("wall")), hand=hand, duration=5.0, settings=settings).warnings
    assert "of the periods the motor direction check took the place of the force of the scene" in warning


def weighted(newtons: float) -> Plan:
    """A bench on which a weight pulls the handle, as on an upright axis; friction alone holds 0.25 N."""
    return unseen_plan(Task("wall"), simulation=Mechanics(gravity=Weight(newtons * METRES)))


@pytest.mark.thorough("54 runs", quick=1)
@pytest.mark.parametrize("wrong", [None, *REVERSED])
@pytest.mark.parametrize("hand", ["held still", "held hard", "led"])
@pytest.mark.parametrize("weight", [-12.0, -5.0, -0.5, 0.5, 5.0, 12.0])
def test_a_weight_on_a_handle_that_is_held_neither_hides_nor_turns_its_sign(
    weight: float, hand: str, wrong: str | None
) -> None:
    outcome = rendered(weighted(weight), HELD_BY[hand], [] if wrong is None else [REVERSED[wrong]], seconds=0.3)
    assert outcome.contradicted is (wrong is not None)
    assert outcome.limited is (wrong is not None)
    if wrong is not None:
        assert outcome.largest <= PULSES + ROUNDING


@pytest.mark.thorough("72 runs")
@pytest.mark.parametrize("wrong", [None, *REVERSED])
@pytest.mark.parametrize("dropped_at", [0.005, 0.02, 0.04, 0.07])
@pytest.mark.parametrize("weight", [-12.0, -5.0, -1.0, 1.0, 5.0, 12.0])
def test_a_handle_that_is_dropped_amid_the_pulses_never_shows_a_wrong_sign(
    weight: float, dropped_at: float, wrong: str | None
) -> None:
    """A hand held the weight until then [s after operation enabled]."""
    hand = Hand("held still", mass=1000.0, release=dropped_at)
    outcome = rendered(weighted(weight), hand, [] if wrong is None else [REVERSED[wrong]], seconds=1.0)
    if wrong is None:
        assert not outcome.contradicted
    else:
        assert outcome.contradicted or outcome.limited
        assert outcome.largest <= PULSES + ROUNDING


def stuck(permissions: Permissions) -> Plan:
    """A bench with a friction of 12.6 N, a quarter of rated torque."""
    return unseen_plan(Task("wall"), coulomb_friction=0.1, permissions=permissions)


@pytest.mark.thorough("2 cases of one rule", quick=1)
@pytest.mark.parametrize(
    ("permissions", "largest", "key"),
    [
        (Permissions(), PULSES, "axis.handle.permissions.sign_effort, now 5 N"),
        (Permissions(sign_effort=30.0), 0.15, "axis.handle.permissions.sign_pulse, now 0.15 of rated torque"),
    ],
)
def test_what_friction_holds_is_refused_at_the_bound_with_the_key_that_permits_more(
    permissions: Permissions, largest: float, key: str
) -> None:
    outcome = rendered(stuck(permissions), None, seconds=5.0)
    assert isinstance(outcome.error, PlanError)
    assert "did not move the handle in 3 attempts" in str(outcome.error)
    assert key in str(outcome.error)
    assert outcome.largest == pytest.approx(largest, abs=1e-3)
    assert outcome.largest <= largest + ROUNDING


@pytest.mark.parametrize("wrong", [None, *REVERSED])
def test_a_permission_of_more_shows_the_sign_of_a_handle_with_much_friction(wrong: str | None) -> None:
    plan = stuck(Permissions(sign_pulse=0.3, sign_effort=30.0))
    outcome = rendered(plan, None, [] if wrong is None else [REVERSED[wrong]], seconds=0.5)
    assert outcome.contradicted is (wrong is not None)
    assert outcome.limited is (wrong is not None)
    if wrong:
        assert outcome.largest <= 0.3 + ROUNDING
        assert outcome.largest > 0.25


@pytest.mark.thorough("every drive at every rate", quick=3)
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("drive", SHIPPED)
def test_the_simulated_bench_of_every_profile_has_the_right_sign(drive: str, rate: float) -> None:
    """Which is why the rig of the shipped bench says that it was seen."""
    plan = unseen_plan(Task("constant", drive=drive, rate=rate, settings=SOFT))
    assert not rendered(plan, None, seconds=1.0).limited
    assert rendered(plan, None, [REVERSED["encoder"]], seconds=1.0).contradicted


@pytest.mark.thorough("60 drawn benches, each right and wrong")
@pytest.mark.parametrize("seed", range(60))
def test_drawn_benches_show_their_sign_or_stay_limited(seed: int) -> None:
    """Inertia and friction over two decades, encoders from 100 counts on, all rates, any hand."""
    draw = np.random.default_rng(seed)
    changes = {
        "inertia": float(10.0 ** draw.uniform(-5.0, -3.0)),
        "coulomb_friction": float(10.0 ** draw.uniform(-3.5, -1.1)),
        "viscous_damping": float(10.0 ** draw.uniform(-4.5, -2.5)),
        "encoder_counts_per_revolution": int(10.0 ** draw.uniform(2.0, 5.0)),
    }
    task = Task("constant", rate=float(draw.choice(RATES)), settings=SOFT | {"end_stop.stiffness": 1.0})
    plan = unseen_plan(task, **changes)
    hand = HELD_BY[str(draw.choice(sorted(HELD_BY)))]
    right = rendered(plan, hand, seconds=3.0)
    assert not right.contradicted
    for wrong in REVERSED.values():
        outcome = rendered(plan, hand, [wrong], seconds=3.0)
        assert outcome.contradicted or outcome.limited
        assert outcome.largest <= PULSES


@pytest.mark.thorough("every scene, held in every way", quick=1)
@pytest.mark.parametrize("hand", ["free", "pushed", "knocked", "held still"])
@pytest.mark.parametrize("scene", SCENES)
def test_with_both_signs_wrong_no_scene_gives_energy_or_trips(scene: str, hand: str) -> None:
    """Torque and motion agree, so that nothing in the loop can see it; what is left is a mirrored scene."""
    outcome = rendered(unseen_plan(Task(scene)), HELD_BY[hand], list(REVERSED.values()), seconds=2.0)
    assert outcome.error is None
    assert all(ledger.tally.largest < ledger.tally.limit for ledger in outcome.cycle.ledgers)


@pytest.mark.thorough("seconds of a run")
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_with_both_signs_wrong_the_wall_on_the_right_is_on_the_left(side: float) -> None:
    """6 N to this side: on the left they meet 600 N/m 20 mm away, on the right nothing."""
    hand = Hand("leans", (Piece(0.0, 0.0, side * 3.0), Piece(2.0, side * 6.0)))
    outcome = rendered(unseen_plan(Task("wall")), hand, list(REVERSED.values()), seconds=6.0)
    motion = outcome.motions["handle"]
    place = METRES * float(motion.sample(np.array([motion.end_ns - 1]))[0][0])
    if side < 0.0:
        assert place == pytest.approx(-WALL_AT - 6.0 / 600.0, abs=0.0005), "friction holds a handle within 0.4 mm"
    else:
        assert place > 0.1


@pytest.mark.thorough("seconds of a run")
def test_a_knob_that_a_hand_turns_away_from_the_first_pulse_is_limited_and_not_refused() -> None:
    hand = Hand("pull", (Piece(0.0, 0.0, -12.0), Piece(0.5, -6.0)))
    outcome = rendered(unseen_plan(Task("pendulum")), hand, seconds=5.0)
    assert outcome.error is None
    assert outcome.limited


@pytest.mark.parametrize("wrong", REVERSED)
def test_one_reversed_drive_of_two_keeps_force_from_both(wrong: str) -> None:
    plan = unseen_plan(Task("virtual_shaft"))
    second = replace(REVERSED[wrong], node=plan.axes[1].node)
    outcome = rendered(plan, HELD_BY["pushed"], [second])
    assert outcome.contradicted
    assert outcome.largest <= SMALL + ROUNDING
    assert f"axis {plan.axes[1].name}: motor direction wrong: test pulses of" in str(outcome.error)


def test_one_sign_that_is_hidden_of_two_keeps_force_from_both() -> None:
    plan = unseen_plan(Task("virtual_shaft"))
    outcome = rendered(plan, HELD_BY["led rigidly"])
    assert outcome.error is None
    hidden, seen = (axis.name for axis in plan.axes)
    assert (outcome.cycle.axes[hidden].sign.unseen is None, outcome.cycle.axes[seen].sign.unseen is None) == (
        False,
        True,
    )
    assert outcome.torques[hidden] <= PULSES
    assert outcome.torques[seen] <= SMALL + ROUNDING


@pytest.mark.parametrize("wrong", [None, *REVERSED])
def test_a_drive_with_velocity_only_shows_its_sign_too(wrong: str | None) -> None:
    plan = plan_of(rig=rig_of(WALL, seen=Seen()), profile=VELOCITY_ONLY)
    outcome = rendered(plan, HELD_BY["held still"], [] if wrong is None else [REVERSED[wrong]], seconds=0.3)
    assert outcome.contradicted is (wrong is not None)
    assert outcome.limited is (wrong is not None)


def test_a_trip_names_both_possibilities_and_what_is_no_remedy() -> None:
    with pytest.raises(SafetyTripError) as raised:
        run("wall", rig=unseen_rig(Task("wall")), faults=[REVERSED["torque"]], duration=1.0)
    assert "motor direction wrong: test pulses of" in str(raised.value)
    assert "Do not change `sign` of the mechanism in the rig" in str(raised.value)


def test_the_probe_brings_the_handle_back_to_where_it_was() -> None:
    """A free handle: the zero of the scene is where it was enabled, and the pulses leave it there, to some counts."""
    plan = unseen_plan(Task("wall"))
    outcome = rendered(plan, None, seconds=0.12)
    probe = sign_probe(plan.axes[0], plan.period)
    assert probe is not None
    assert probe.travel is not None
    assert not outcome.limited
    position = outcome.cycle.row[outcome.cycle.columns.index("handle.position")]
    assert abs(position) <= probe.travel


@pytest.mark.thorough("pulses of seconds")
def test_a_coarse_encoder_makes_the_pulses_longer_and_the_travel_is_told() -> None:
    """24 counts a turn of 50 mm: the pulses move the handle by four of them, 8.3 mm, and without friction by 10 mm."""
    plan = unseen_plan(Task("wall"), encoder_counts_per_revolution=24)
    probe = sign_probe(plan.axes[0], plan.period)
    assert probe is not None
    free = probe.travel
    assert free is not None
    assert free * (1.0 - probe.friction / probe.stages[0].effort) == pytest.approx(4 * 0.05 / 24, rel=0.05)
    (step,) = [step for step in plan.steps if step.startswith("sign: ")]
    assert "by up to 0.0101 m; the largest pulses move a handle that breaks loose by up to 0.0788 m" in step
    # At four counts a pair may show less than three, and the next stage is needed.
    assert rendered(plan, None, seconds=5.0).seen_at <= 2.5 * probe.time


@pytest.mark.thorough("a minute of walls of half the limit")
@pytest.mark.parametrize("hand", ["push", "tap", "release"])
@pytest.mark.parametrize("scene", ["wall", "damped_wall", "predicted_wall", "spring"])
def test_a_minute_of_a_stiff_wall_is_no_contradiction(scene: str, hand: str) -> None:
    element = "wall" if scene == "damped_wall" else scene
    settings = {f"{element}.stiffness": "max/2"}
    assert run(scene, endless_rig(scene), hand=hand, duration=60.0, settings=settings).cycles == 60_000


TURNED: tuple[faults.Fault, ...] = (
    faults.EncoderReversed("encoder_reversed", 2.0),
    faults.TorqueReversed("torque_reversed", 2.0),
)


@pytest.mark.thorough("2 cases of one rule", quick=1)
@pytest.mark.parametrize("fault", TURNED, ids=lambda fault: fault.kind)
def test_a_sign_that_turns_in_contact_ends_the_run(fault: faults.Fault) -> None:
    """Another tool reverses the drive two seconds later, when the motor holds the handle at its end stop."""
    with pytest.raises(SafetyTripError, match=r"pulses of .* moved the handle .* the wrong way"):
        run("constant", endless_rig("constant"), duration=8.0, faults=[fault])


@pytest.mark.thorough("seconds of knocking")
@pytest.mark.parametrize("mass", [0.7, 1.2, 3.0])
def test_a_virtual_mass_that_is_knocked_is_no_contradiction(mass: float) -> None:
    """Its torque goes against each change of the hand's force, as that of a wrong sign does."""
    rig = endless_rig("inertia")
    assert run("inertia", rig, hand="tap", duration=5.0, force=True, settings={"inertia.mass": mass}).trips == ()


@pytest.mark.thorough("a run each", quick=1)
@pytest.mark.parametrize("lasting", [0.005, 0.02, 0.05])
@pytest.mark.parametrize("force", [-150.0, -60.0, 20.0, 60.0, 150.0])
@pytest.mark.parametrize("scene", ["wall", "spring", "kelvin_voigt"])
def test_a_blow_of_the_hand_raises_a_doubt_at_most(scene: str, force: float, lasting: float) -> None:
    """It changes its force against the torque, as a wrong sign does; pulses then tell the two apart."""
    blow = faults.HandHit("hand_hit", 1.5, force, lasting)
    outcome = rendered(select(Task(scene)).plan, HANDS["push"], [blow], seconds=3.5)
    assert not outcome.contradicted


@pytest.mark.thorough("8 s of a run")
def test_a_blow_deep_into_a_wall_never_throws_the_handle_out_again() -> None:
    """100 N for 20 ms while 6 N lean on the wall; the hand lets go 1.5 s later, half a second after the sign was seen.

    Until the handle is out the motor gives no more than while the sign was looked for, 5 % of rated torque.
    """
    hand = Hand("push", (Piece(0.0, 0.0, 12.0), Piece(0.5, 6.0))).hitting(1.5, 100.0, 0.02).letting_go(3.0)
    outcome = rendered(select(Task("wall", rig=endless_rig("wall"))).plan, hand, seconds=8.0)
    assert outcome.error is None
    assert outcome.cycle.axes["handle"].sign.doubts == 1
    seen_ns, trajectory = outcome.cycle.axes["handle"].state.permitted_ns, outcome.motions["handle"]
    assert seen_ns is not None
    at_ns, torques = trajectory.targets()
    place = METRES * trajectory.sample(at_ns)[0]
    deep = (at_ns > seen_ns) & (np.minimum.accumulate(np.where(at_ns > seen_ns, place, 1.0)) > WALL_AT)
    assert place[deep].max() > 0.5, "where the wall asks for hundreds of newtons"
    assert place[-1] < WALL_AT, "the hand let go, and 2.5 N brought the handle out"
    assert np.abs(torques[deep]).max() <= 0.05 * 0.4 + 1e-9, "[N·m] at the motor"
