"""The kinds of element by name; `element_type` imports the module of a kind when it is first used."""

from importlib import import_module

from haptic_fieldbus.scenes.element import AnyElement

# Module and class as texts, so that a scene imports only the kinds that it contains. The order is that of the
# documentation.
ELEMENTS = {
    "braking_pulse": ("haptic_fieldbus.scenes.braking_pulse", "BrakingPulse"),
    "constant": ("haptic_fieldbus.scenes.constant", "Constant"),
    "coupling": ("haptic_fieldbus.scenes.coupling", "Coupling"),
    "dahl": ("haptic_fieldbus.scenes.dahl", "Dahl"),
    "damped_sprung_mass": ("haptic_fieldbus.scenes.damped_sprung_mass", "DampedSprungMass"),
    "damper": ("haptic_fieldbus.scenes.damper", "Damper"),
    "detents": ("haptic_fieldbus.scenes.detents", "Detents"),
    "end_stop": ("haptic_fieldbus.scenes.end_stop", "EndStop"),
    "free_puck": ("haptic_fieldbus.scenes.free_puck", "FreePuck"),
    "friction": ("haptic_fieldbus.scenes.friction", "Friction"),
    "generalised_maxwell": ("haptic_fieldbus.scenes.generalised_maxwell", "GeneralisedMaxwell"),
    "grating": ("haptic_fieldbus.scenes.grating", "Grating"),
    "gravity": ("haptic_fieldbus.scenes.gravity", "Gravity"),
    "hunt_crossley": ("haptic_fieldbus.scenes.hunt_crossley", "HuntCrossley"),
    "inertia": ("haptic_fieldbus.scenes.inertia", "Inertia"),
    "kelvin_voigt": ("haptic_fieldbus.scenes.kelvin_voigt", "KelvinVoigt"),
    "lugre": ("haptic_fieldbus.scenes.lugre", "LuGre"),
    "magnet": ("haptic_fieldbus.scenes.magnet", "Magnet"),
    "needle": ("haptic_fieldbus.scenes.needle", "Needle"),
    "pendulum": ("haptic_fieldbus.scenes.pendulum", "Pendulum"),
    "periodic": ("haptic_fieldbus.scenes.periodic", "Periodic"),
    "predicted_wall": ("haptic_fieldbus.scenes.predicted_wall", "PredictedWall"),
    "proxy": ("haptic_fieldbus.scenes.proxy", "Proxy"),
    "ramp": ("haptic_fieldbus.scenes.ramp", "Ramp"),
    "spring": ("haptic_fieldbus.scenes.spring", "Spring"),
    "sprung_mass": ("haptic_fieldbus.scenes.sprung_mass", "SprungMass"),
    "standard_linear_solid": ("haptic_fieldbus.scenes.standard_linear_solid", "StandardLinearSolid"),
    "stick_slip": ("haptic_fieldbus.scenes.stick_slip", "StickSlip"),
    "texture": ("haptic_fieldbus.scenes.texture", "Texture"),
    "virtual_coupling": ("haptic_fieldbus.scenes.virtual_coupling", "VirtualCoupling"),
    "wall": ("haptic_fieldbus.scenes.wall", "Wall"),
}


def element_type(kind: str) -> type[AnyElement]:
    """Return the class of a kind; raises KeyError when the kind is not in `ELEMENTS`."""
    module, name = ELEMENTS[kind]
    found: type[AnyElement] = getattr(import_module(module), name)
    return found
