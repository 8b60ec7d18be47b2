"""The drive inside: a drive with the objects of CiA 402 that stands behind the registers of a Modbus profile."""

from dataclasses import dataclass

from haptic_fieldbus.drive.cia402 import (
    Cia402Profile,
    LinkLoss,
    MappedObject,
    OptionCode,
    PositionSection,
    TorqueSection,
    VelocitySection,
)
from haptic_fieldbus.protocols.modbus.profile import ModbusProfile, Register, WrittenRegister

CYCLIC_TORQUE = 10
POSITION, VELOCITY, TARGET, ACTUAL, DEMAND, RATED = 0x6064, 0x606C, 0x6071, 0x6077, 0x6074, 0x6076
ABORT_OPTION, REACTION_OPTION = 0x6007, 0x605E


@dataclass(frozen=True, kw_only=True)
class InnerProfile(Cia402Profile):
    """A drive whose watch on its master is that of its Modbus profile."""

    watched: bool

    @property
    def guarded(self) -> bool:
        return self.watched


def inner_profile(profile: ModbusProfile) -> InnerProfile:
    """Return the drive inside."""
    torque = profile.torque
    mode = profile.mode.value if profile.mode is not None and profile.power.table == "cia402" else CYCLIC_TORQUE
    return InnerProfile(
        schema=1,
        drive=profile.drive,
        timing=profile.timing,
        name=profile.name,
        source=profile.source,
        torque=TorqueSection(
            mode,
            _object(TARGET, torque.target),
            _object(ACTUAL, torque.actual) if torque.actual is not None else None,
            _object(RATED, torque.rated) if torque.rated is not None else None,
            _object(DEMAND, torque.demand) if torque.demand is not None else None,
        ),
        position=PositionSection(_object(POSITION, profile.position.actual)) if profile.position is not None else None,
        velocity=VelocitySection(_object(VELOCITY, profile.velocity.actual)) if profile.velocity is not None else None,
        link_loss=LinkLoss(
            abort_connection_option=_option(profile, ABORT_OPTION),
            fault_reaction_option=_option(profile, REACTION_OPTION),
        ),
        watched=profile.guarded,
    )


def written_registers(profile: ModbusProfile) -> tuple[WrittenRegister, ...]:
    """Return the registers with a value of the profile: of its set-up, and of the choice of its reaction."""
    return (*profile.setup, *(profile.watchdog.writes if profile.watchdog is not None else ()))


def _object(index: int, register: Register) -> MappedObject:
    return MappedObject(index, register.type, unit=register.unit)


def _option(profile: ModbusProfile, index: int) -> OptionCode | None:
    found = (register for register in written_registers(profile) if register.object == index)
    return next((OptionCode(index, register.value) for register in found), None)
