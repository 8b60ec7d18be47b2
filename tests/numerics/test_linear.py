"""Sums of linear systems, and their rest."""

import numpy as np
import pytest

from haptic_fieldbus.numerics.linear import StateSpace, equilibrium, gain, parallel


def lag(rate: float) -> StateSpace:
    return StateSpace(np.array([[-rate]]), np.array([[rate]]), np.array([[1.0]]), np.array([[0.5]]))


def test_a_gain_has_no_state() -> None:
    system = gain([[2.0, -3.0]])
    assert system.order == 0
    np.testing.assert_array_equal(system.d @ [1.0, 1.0], [-1.0])


@pytest.mark.parametrize("s", [0.1j, 3.0, 2.0 + 5.0j])
def test_the_sum_of_systems_has_the_sum_of_their_transfer_functions(s: complex) -> None:
    def transfer(system: StateSpace) -> complex:
        states = np.linalg.solve(s * np.eye(system.order) - system.a, system.b.astype(complex))
        return complex((system.c @ states + system.d)[0, 0])

    parts = [lag(1.0), gain([[4.0]]), lag(7.0)]
    assert parallel(parts).order == 2
    assert transfer(parallel(parts)) == pytest.approx(sum(transfer(part) for part in parts))


def test_the_equilibrium_balances_the_load() -> None:
    np.testing.assert_allclose(equilibrium(np.array([[0.0, 1.0], [-2.0, -1.0]]), np.array([0.0, 6.0])), [3.0, 0.0])


def test_of_many_equilibria_the_smallest_is_taken() -> None:
    np.testing.assert_allclose(equilibrium(np.array([[0.0, 0.0], [0.0, 2.0]]), np.array([0.0, 4.0])), [0.0, -2.0])
