"""Fixtures of the tests of recordings."""

from tests.cli.conftest import command as command
