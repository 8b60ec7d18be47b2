"""Mathematics without hardware: integrators, estimators, exact discretisation, stability and passivity."""
