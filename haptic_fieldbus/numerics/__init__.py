"""Mathematics without hardware: integrators, estimators, exact discretisation."""
