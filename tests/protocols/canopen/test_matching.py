"""Which profiles fit a device, and how sure that is."""

from dataclasses import replace

import pytest

from haptic_fieldbus.drive.cia402 import IdentitySection
from haptic_fieldbus.protocols.canopen.fitting import MatchQuality, fitting
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, canopen_profile
from haptic_fieldbus.protocols.catalogue import load_profile

EPOS4 = canopen_profile(load_profile("maxon_epos4"))
ANY = canopen_profile(load_profile("generic_cia402"))
CODED = replace(EPOS4, name="coded", identity=IdentitySection(0xFB, (0x61500000, 0x63500000)))
PROFILES = (ANY, EPOS4, CODED)


@pytest.mark.parametrize(
    ("vendor", "product", "name", "expected"),
    [
        (
            0xFB,
            0x63500000,
            "",
            [(CODED, MatchQuality.PRODUCT), (EPOS4, MatchQuality.VENDOR), (ANY, MatchQuality.DRIVE)],
        ),
        (
            0xFB,
            0x63500000,
            "EPOS4 50/5",
            [(CODED, MatchQuality.PRODUCT), (EPOS4, MatchQuality.MODEL), (ANY, MatchQuality.DRIVE)],
        ),
        (0xFB, 1, "Epos4", [(EPOS4, MatchQuality.MODEL), (ANY, MatchQuality.DRIVE)]),
        (0xFB, None, None, [(EPOS4, MatchQuality.VENDOR), (ANY, MatchQuality.DRIVE)]),
        (0xFC, 0x63500000, "EPOS4", [(ANY, MatchQuality.DRIVE)]),
        (None, None, None, [(ANY, MatchQuality.DRIVE)]),
    ],
    ids=["product", "product and name", "name", "vendor", "another vendor", "says nothing"],
)
def test_the_surest_comes_first(
    vendor: int | None, product: int | None, name: str | None, expected: list[tuple[CanopenProfile, MatchQuality]]
) -> None:
    assert fitting(PROFILES, vendor, product, name) == expected
