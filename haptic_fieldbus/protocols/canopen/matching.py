"""Which profiles fit a device, by what it says of itself, and how sure that is."""

from collections.abc import Iterable
from enum import Enum

from haptic_fieldbus.protocols.canopen.profile import CanopenProfile


class Sureness(Enum):
    """How well a profile fits a device, the best first; the value is the words for people."""

    PRODUCT = "sure: vendor and product code are those of the profile"
    MODEL = "likely: the vendor is that of the profile, and the device names the model"
    VENDOR = "perhaps: the vendor is that of the profile, which names no product codes"
    DRIVE = "no more than a guess: it is a CiA 402 drive, of a vendor without a profile"


ORDER = tuple(Sureness)


def fitting(
    profiles: Iterable[CanopenProfile], vendor_id: int | None, product_code: int | None, name: str | None
) -> list[tuple[CanopenProfile, Sureness]]:
    """Return the profiles that may be that of a CiA 402 drive, the surest first."""
    graded = [(profile, _sureness(profile, vendor_id, product_code, name or "")) for profile in profiles]
    found = [(profile, sureness) for profile, sureness in graded if sureness is not None]
    return sorted(found, key=lambda each: ORDER.index(each[1]))


def _sureness(profile: CanopenProfile, vendor_id: int | None, product_code: int | None, name: str) -> Sureness | None:
    expected = profile.identity
    if expected.vendor_id is None and not expected.product_codes:
        return Sureness.DRIVE
    if expected.vendor_id is not None and expected.vendor_id != vendor_id:
        return None
    if expected.product_codes:
        return Sureness.PRODUCT if product_code in expected.product_codes else None
    model = profile.drive.model.split()[0].casefold()
    return Sureness.MODEL if model in name.casefold() else Sureness.VENDOR
