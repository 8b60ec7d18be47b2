"""Pure mathematics: integrators, estimators, exact discretisation, passivity."""
