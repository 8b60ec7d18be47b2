"""Shipped profiles are read in each test here, though a run reads them once: these tests cover how they are read."""

import pytest

from haptic_fieldbus.protocols import catalogue


@pytest.fixture(autouse=True)
def _read_anew() -> None:
    catalogue._shipped.cache_clear()
