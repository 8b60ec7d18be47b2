"""A wall on the side from which the handle came, at whatever depth; the leak of a wall."""

from haptic_fieldbus.scenes.proxy import Proxy
from tests.scenes.sheet import Sheet, at_once, damper_leak, passing, resting, spring_leak

SHEET = Sheet(
    examples=(
        Proxy("handle", stiffness=600.0, position=0.01),
        Proxy("handle", stiffness=600.0, position=-0.01, damping=3.0),
    ),
    steepness=lambda proxy: (proxy.stiffness, proxy.damping, 0.0),
    jump=lambda proxy, speed: proxy.damping * speed,
    stiffest=lambda proxy: (at_once(proxy.position - 0.01, proxy.position + 0.01), 1.0),
    continuous=lambda proxy, motion: 0.0,
    sampled=lambda proxy, motion: spring_leak(proxy.stiffness, motion) + damper_leak(proxy.damping, motion),
    silent=lambda proxy: [
        resting(proxy.position + 0.01, proxy.position + 0.5, proxy.position),
        resting(proxy.position, proxy.position - 0.01, proxy.position),
        passing(proxy.position - 0.05, proxy.position - 1e-6, 0.5),
    ],
    signs=lambda proxy: [
        (resting(proxy.position - 0.01, proxy.position + 0.02), -1),
        (resting(proxy.position + 0.01, proxy.position - 0.02), 1),
        (resting(proxy.position, proxy.position + 1e-9, proxy.position - 50.0), 1),
    ],
)
