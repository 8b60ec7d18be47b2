"""Which drive it is: 0 and all ones are no number, and only a serial number tells two drives of one model apart."""

import struct
from dataclasses import replace

import pytest

from haptic_fieldbus.drive.profile import DataType, Identity, digest_of, known_number

DRIVE = Identity(0xFB, 0x6050_0000, 0x0168_0000, 0x1234)


@pytest.mark.parametrize(
    ("number", "type", "known"),
    [
        (0x1234, DataType.UINT32, 0x1234),
        (0xFFFF, DataType.UINT32, 0xFFFF),
        (0xFFFF_FFFE, DataType.UINT32, 0xFFFF_FFFE),
        (0, DataType.UINT32, None),
        (0xFFFF_FFFF, DataType.UINT32, None),
        (0xFFFF, DataType.UINT16, None),
        (0, DataType.UINT16, None),
        (-1, DataType.INT16, None),
        (-2, DataType.INT16, -2),
        (None, DataType.UINT32, None),
    ],
)
def test_a_number_that_was_never_given_is_unknown(number: int | None, type: DataType, known: int | None) -> None:
    assert known_number(number, type) == known


def test_a_drive_without_a_serial_number_has_no_name_at_any_place() -> None:
    assert replace(DRIVE, serial=None).file_name("can0 5") is None


def test_the_name_of_a_drive_is_the_same_everywhere_and_after_an_update() -> None:
    assert DRIVE.file_name("can0 5") == "000000fb-60500000-00001234"
    assert replace(DRIVE, revision=7).file_name("can1 6") == DRIVE.file_name("can0 5")
    assert replace(DRIVE, serial=0x4321).file_name("can0 5") != DRIVE.file_name("can0 5")


@pytest.mark.parametrize("unknown", ["vendor", "product"])
def test_of_an_unknown_maker_or_model_the_name_holds_at_one_place_alone(unknown: str) -> None:
    drive = replace(DRIVE, **{unknown: None})
    here, there = drive.file_name("can0 5"), drive.file_name("can0 6")
    assert here is not None
    assert here != there
    assert here == drive.file_name("can0 5")


def test_the_first_difference_is_that_of_the_serial_number() -> None:
    assert DRIVE.difference(DRIVE) == ""
    assert DRIVE.difference(Identity()) == "serial"
    for name in ("vendor", "product", "revision", "serial"):
        assert DRIVE.difference(replace(DRIVE, **{name: 1})) == name


def test_a_digest_changes_with_each_text_and_their_order() -> None:
    texts = ("6007h:00 = 2", "605Eh:00 = 0")
    found = {digest_of(each) for each in (texts, texts[::-1], texts[:1], ("".join(texts),), ("\n".join(texts),))}
    assert len(found) == 5
    # SHA-256 of the JSON list, by coreutils: printf '["6007h:00 = 2", "605Eh:00 = 0"]' | sha256sum | cut -c-16
    assert digest_of(texts) == "99969b466a916871"


@pytest.mark.parametrize("each", DataType)
def test_a_type_has_the_size_and_the_limits_of_its_struct(each: DataType) -> None:
    each.__init__(each.value)  # type: ignore[misc]  # as at import, before any test
    assert each.size == struct.calcsize(each.code)
    for limit in each.limits:
        assert each.unpack(each.pack(limit)) == limit == struct.unpack("<" + each.code, each.pack(limit))[0]
    with pytest.raises(struct.error):
        each.pack(each.limits[1] + 1)
