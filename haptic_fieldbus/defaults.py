"""What is taken where nobody says otherwise; each default stands here alone."""

SIMULATION = "sim"
"""The simulated bus without a bit rate: it has that of each bus of the rig in whose place it stands."""

DEFAULT_DRIVE = "maxon_epos4"
DEFAULT_PROTOCOL = "canopen"
DEFAULT_BUS = SIMULATION
DEFAULT_BIT_RATE = 1_000_000
"""[bit/s]"""
DEFAULT_NODE = 1
DEFAULT_RATE = 1000.0
"""[Hz]"""
DEFAULT_METHOD = "exact-foh"
"""Integrator of virtual states."""
DEFAULT_ESTIMATOR = "backward-difference"
"""Of velocity."""
DEFAULT_DURATION = 10.0
"""Of a run [s]."""
DEFAULT_HAND = "push"
"""Of a run whose scene names none."""
DEFAULT_SEED = 0

DEFAULT_HOSTED_HAND = "none"
"""On a bus that other programs join."""

DEFAULT_MOTION = "step"
"""Of the open loop."""
DEFAULT_AMPLITUDE = 1.0
"""[m or rad]"""
DEFAULT_MOTION_DURATION = 1.0
"""[s]; a file has its own."""

DEFAULT_REPORT = "report"
"""The folder."""
