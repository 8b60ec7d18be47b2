"""Defaults of commands and of the Python API; each is defined only here."""

SIMULATION = "sim"
"""Name of the simulated bus; without a bit rate it has that of the replaced bus of a rig."""

DEFAULT_DRIVE = "maxon_epos4"
DEFAULT_MODBUS_DRIVE = "generic_cia402_modbus"
DEFAULT_PROTOCOL = "canopen"
DEFAULT_BUS = SIMULATION
DEFAULT_BIT_RATE = 1_000_000
"""[bit/s]"""
DEFAULT_NODE = 1
DEFAULT_RATE = 1000.0
"""[Hz]"""
DEFAULT_METHOD = "exact-foh"
"""Integrator of virtual states."""
DEFAULT_FADE_IN = 0.5
"""Time from *operation enabled* to the full limit of the force [s]."""
DEFAULT_ESTIMATOR = "backward-difference"
"""Estimator of velocity."""
DEFAULT_DURATION = 10.0
"""Duration of a run [s]."""
DEFAULT_HAND = "push"
"""Simulated hand of a run whose scene names none."""
DEFAULT_SEED = 0

DEFAULT_HOSTED_HAND = "none"
"""Simulated hand of drives that are hosted for other programs."""

DEFAULT_MOTION = "step"
"""Motion of the open loop."""
DEFAULT_AMPLITUDE = 1.0
"""Amplitude of that motion [m or rad]."""
DEFAULT_MOTION_DURATION = 1.0
"""Duration of that motion [s]; a motion from a file has its own."""

HIGHEST_NUMBER = 255
"""Largest number of a drive on any bus."""

DEFAULT_REPORT = "report"
"""Folder of the report."""

DEFAULT_ENGINE = "verdict"
"""Engine of a sweep."""
DEFAULT_STEPS = 10_000
"""Periods of each simulated loop of a sweep."""
DEFAULT_SWEEP = "sweep"
"""Folder of the rows of a sweep, on the command line."""

DEFAULT_VCAN = "vcan0"
"""Virtual CAN interface of a command."""
