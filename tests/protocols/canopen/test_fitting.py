"""A profile of no particular drive beside the objects of a drive: what is kept, what is left out, what takes its place.

The drive is a table of objects, from which each test takes some away.
"""

from dataclasses import replace

import pytest

from haptic_fieldbus.drive.cia402 import MappedObject, OptionCode
from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.errors import EdsError
from haptic_fieldbus.protocols.canopen.fitting import fitted, uploaded
from haptic_fieldbus.protocols.canopen.profile import NO_SUCH, CanopenProfile
from tests.builders import canopen

GENERIC = canopen("generic_cia402")
Octets = dict[tuple[int, int], bytes | None]
ALL: Octets = {
    (0x1006, 0): bytes(4), (0x100C, 0): bytes(2), (0x100D, 0): bytes(1), (0x1016, 1): bytes(4),
    (0x6007, 0): bytes(2), (0x605E, 0): bytes(2), (0x6040, 0): bytes(2), (0x6041, 0): bytes(2),
    (0x6060, 0): bytes(1), (0x6061, 0): bytes(1), (0x6064, 0): bytes(4), (0x606C, 0): bytes(4),
    (0x6071, 0): bytes(2), (0x6074, 0): bytes(2), (0x6076, 0): bytes(4), (0x6077, 0): bytes(2),
    (0x6087, 0): bytes(4), (0x60C2, 1): b"\x01", (0x60C2, 2): b"\xfd", (0x6502, 0): b"\x88\x02\0\0",
    **{(first + number, 1): bytes(4) for first in (0x1400, 0x1800) for number in range(4)},
    **{(first + number, 0): bytes(1) for first in (0x1600, 0x1A00) for number in range(4)},
}  # fmt: skip
"""Objects of a drive and the octets of their values: it has profile torque and cyclic synchronous torque mode."""


def on(*missing: int, profile: CanopenProfile = GENERIC, **changes: bytes) -> CanopenProfile:
    """The profile fitted to the drive without these objects, with changes such as `x6502=b"…"` at sub-index 0."""
    octets = {key: value for key, value in ALL.items() if key[0] not in missing}
    octets |= {(int(name[1:], 16), 0): value for name, value in changes.items()}
    return fitted(profile, uploaded(profile, lambda index, subindex: octets.get((index, subindex))))


def test_what_the_drive_has_stays_as_the_profile_says() -> None:
    profile = on()
    for section in ("torque", "position", "link_loss", "timing", "identity"):
        assert getattr(profile, section) == getattr(GENERIC, section)
    assert profile.pdo == GENERIC.pdo
    assert not any(source.startswith(NO_SUCH) for source in profile.sources.values())
    # The drive is told the period by what it has for it.
    assert (profile.sync.interpolation_time, profile.sync.powers, profile.sync.cycle_period) == (0x60C2, (-3,), 0x1006)


@pytest.mark.parametrize(("index", "key"), [
    (0x6074, "torque.demand"), (0x6076, "torque.rated"), (0x6077, "torque.actual"),
    (0x1016, "link_loss.heartbeat_consumer"), (0x6007, "link_loss.abort_connection_option"),
    (0x605E, "link_loss.fault_reaction_option"),
])  # fmt: skip
def test_what_it_lacks_is_left_out_with_the_object(index: int, key: str) -> None:
    profile = on(index)
    section, name = key.split(".")
    assert getattr(getattr(profile, section), name) is None
    assert profile.sources[key].startswith(f"{NO_SUCH}{index:04X}h:")


def test_the_echo_falls_back_to_what_there_is() -> None:
    assert on(0x6074).torque.echo == "actual"
    assert on(0x6074, 0x6077).torque.echo == "asked"
    assert on(0x6074, 0x6077, x6071=b"").torque.echo == "none", "6071h can only be written"


@pytest.mark.parametrize(
    ("missing", "guarded", "life_guarding"),
    [
        ((), True, False),
        ((0x6007,), True, False),
        ((0x1016,), True, True),
        ((0x1016, 0x100D), False, False),
        ((0x6007, 0x605E), False, False),
    ],
)
def test_there_is_no_guard_but_one_that_the_drive_has(
    missing: tuple[int, ...], guarded: bool, life_guarding: bool
) -> None:
    profile = on(*missing)
    assert (profile.guarded, profile.link_loss.life_guarding) == (guarded, life_guarding)


def test_a_guard_that_the_profile_does_not_name_is_not_invented() -> None:
    bare = replace(GENERIC, link_loss=replace(GENERIC.link_loss, heartbeat_consumer=None))
    assert not on(profile=bare).guarded


def test_a_drive_without_the_cyclic_mode_takes_profile_torque_with_the_steepest_slope() -> None:
    torque = on(x6502=b"\x08\0\0\0").torque
    assert torque.mode_of_operation == 4
    assert torque.slope is not None
    assert (torque.slope.object, torque.slope.value) == (0x6087, 1_000_000)
    assert on(0x6502).torque.mode_of_operation == 10, "a drive that does not say is asked by its mode"


def test_a_mode_of_the_vendor_is_not_replaced() -> None:
    own = replace(GENERIC, torque=replace(GENERIC.torque, mode_of_operation=-5))
    assert on(profile=own).torque.mode_of_operation == -5


@pytest.mark.parametrize(("code", "unit"), [(b"\0\0\xb5\0", "counts"), (b"\0\0\x41\xff", "0.1 deg")])
def test_the_unit_of_the_position_is_that_of_the_drive(code: bytes, unit: str) -> None:
    position = on(x60A8=code).position
    assert position is not None
    assert position.actual.unit == unit


def test_a_drive_that_cannot_render_force_is_not_usable_and_says_why() -> None:
    for profile, why in (
        (on(0x6071), "there is no 6071h target torque"),
        (on(0x6064, 0x606C), "there is no 6064h position actual value"),
        (on(x60A8=b"\0\0\x01\x01"), "60A8h SI unit position is 01010000h"),
        (on(x6502=b"\x01\0\0\0"), "6502h supported drive modes 1h names no torque mode"),
        (on(x6071=bytes(1)), "6071h target torque is INTEGER8"),
    ):
        assert not profile.drive.usable
        assert why in profile.sources["drive.usable"]
    with pytest.raises(EdsError, match="there is no 6041h"):
        on(0x6041)


def test_without_a_position_the_velocity_is_integrated() -> None:
    profile = on(0x6064)
    assert profile.position is None
    assert profile.velocity is not None
    assert profile.velocity.actual.object == 0x606C


def test_the_pdos_are_those_of_the_drive() -> None:
    more: Octets = {(first + number, sub): bytes(4) for first, sub in ((0x1800, 1), (0x1A00, 0)) for number in (6, 7)}
    octets = {**ALL, **more, (0x1807, 3): b"\x0a\0"}
    profile = fitted(GENERIC, uploaded(GENERIC, lambda index, subindex: octets.get((index, subindex))))
    # TPDO 5 and 6 are missing: 0 entries.
    assert profile.pdo.tpdo_entries == (8, 8, 8, 8, 0, 0, 8, 8)
    assert (profile.pdo.rpdos, profile.pdo.rpdo_entries) == (4, ())
    assert profile.pdo.inhibit_time_default == pytest.approx(0.001)


def test_objects_of_a_vendor_that_the_profile_names_are_asked_too() -> None:
    torque = replace(GENERIC.torque, rated_current=MappedObject(0x203B, DataType.UINT32, 1, "mA"))
    loss = replace(GENERIC.link_loss, fault_reaction_option=OptionCode(0x2FF0, 1), heartbeat_consumer=0x2FF1)
    own = replace(GENERIC, torque=torque, link_loss=loss)
    found = on(profile=own)
    assert (found.torque.rated_current, found.link_loss.fault_reaction_option) == (None, None)
    octets = {**ALL, (0x203B, 1): bytes(4), (0x2FF0, 0): bytes(2), (0x2FF1, 1): bytes(4)}
    found = fitted(own, uploaded(own, lambda index, subindex: octets.get((index, subindex))))
    assert (found.torque, found.link_loss) == (torque, loss)
