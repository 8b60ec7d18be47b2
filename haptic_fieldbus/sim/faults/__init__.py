"""Faults of a simulated bench, as data: the kinds of `[[fault]]` in a TOML file.

`at` [s] counts from *operation enabled*, and counts anew if a drive is enabled again before any fault has happened;
faults without `at` exist from power-on. `node` is the node-ID of the drive, None every drive of the bus; `bus` is a bus
of the rig, None every bus. `duration` [s] None is for ever.
"""

from haptic_fieldbus.sim.faults.file import Fault as Fault
from haptic_fieldbus.sim.faults.file import FaultFile as FaultFile
from haptic_fieldbus.sim.faults.file import TimedFault as TimedFault
from haptic_fieldbus.sim.faults.file import faults_of as faults_of
from haptic_fieldbus.sim.faults.file import faults_on as faults_on
from haptic_fieldbus.sim.faults.file import kinds_of as kinds_of
from haptic_fieldbus.sim.faults.file import load_faults as load_faults
from haptic_fieldbus.sim.faults.file import toml_of as toml_of
from haptic_fieldbus.sim.faults.kinds import AnswerCorrupted as AnswerCorrupted
from haptic_fieldbus.sim.faults.kinds import AnswerDelayed as AnswerDelayed
from haptic_fieldbus.sim.faults.kinds import AnswerDisturbance as AnswerDisturbance
from haptic_fieldbus.sim.faults.kinds import AnswerException as AnswerException
from haptic_fieldbus.sim.faults.kinds import AnswerFault as AnswerFault
from haptic_fieldbus.sim.faults.kinds import AnswerGarbage as AnswerGarbage
from haptic_fieldbus.sim.faults.kinds import AnswerLost as AnswerLost
from haptic_fieldbus.sim.faults.kinds import AnswerSwapped as AnswerSwapped
from haptic_fieldbus.sim.faults.kinds import AnswerTruncated as AnswerTruncated
from haptic_fieldbus.sim.faults.kinds import AnswerWrongUnit as AnswerWrongUnit
from haptic_fieldbus.sim.faults.kinds import BusOff as BusOff
from haptic_fieldbus.sim.faults.kinds import ClockStep as ClockStep
from haptic_fieldbus.sim.faults.kinds import ConnectionReset as ConnectionReset
from haptic_fieldbus.sim.faults.kinds import DeadGuard as DeadGuard
from haptic_fieldbus.sim.faults.kinds import Disturbance as Disturbance
from haptic_fieldbus.sim.faults.kinds import DriveFault as DriveFault
from haptic_fieldbus.sim.faults.kinds import DriveFaultKind as DriveFaultKind
from haptic_fieldbus.sim.faults.kinds import DuplicateNode as DuplicateNode
from haptic_fieldbus.sim.faults.kinds import Emergency as Emergency
from haptic_fieldbus.sim.faults.kinds import EncoderJump as EncoderJump
from haptic_fieldbus.sim.faults.kinds import EncoderReversed as EncoderReversed
from haptic_fieldbus.sim.faults.kinds import EncoderScaling as EncoderScaling
from haptic_fieldbus.sim.faults.kinds import ErrorFrame as ErrorFrame
from haptic_fieldbus.sim.faults.kinds import FaultTargets as FaultTargets
from haptic_fieldbus.sim.faults.kinds import ForeignFrame as ForeignFrame
from haptic_fieldbus.sim.faults.kinds import ForeignSetPoints as ForeignSetPoints
from haptic_fieldbus.sim.faults.kinds import FrameDelayed as FrameDelayed
from haptic_fieldbus.sim.faults.kinds import FrameDropped as FrameDropped
from haptic_fieldbus.sim.faults.kinds import FrameDuplicated as FrameDuplicated
from haptic_fieldbus.sim.faults.kinds import FrameGroup as FrameGroup
from haptic_fieldbus.sim.faults.kinds import FrameWrongLength as FrameWrongLength
from haptic_fieldbus.sim.faults.kinds import FrameWrongNode as FrameWrongNode
from haptic_fieldbus.sim.faults.kinds import HandFault as HandFault
from haptic_fieldbus.sim.faults.kinds import HandHit as HandHit
from haptic_fieldbus.sim.faults.kinds import HandRelease as HandRelease
from haptic_fieldbus.sim.faults.kinds import HeartbeatLost as HeartbeatLost
from haptic_fieldbus.sim.faults.kinds import HostFault as HostFault
from haptic_fieldbus.sim.faults.kinds import HostLate as HostLate
from haptic_fieldbus.sim.faults.kinds import HostPaused as HostPaused
from haptic_fieldbus.sim.faults.kinds import InterfaceDown as InterfaceDown
from haptic_fieldbus.sim.faults.kinds import LastingFault as LastingFault
from haptic_fieldbus.sim.faults.kinds import LineDisturbance as LineDisturbance
from haptic_fieldbus.sim.faults.kinds import LineFault as LineFault
from haptic_fieldbus.sim.faults.kinds import MissingNode as MissingNode
from haptic_fieldbus.sim.faults.kinds import MissingRpdos as MissingRpdos
from haptic_fieldbus.sim.faults.kinds import MissingTpdos as MissingTpdos
from haptic_fieldbus.sim.faults.kinds import NodeReset as NodeReset
from haptic_fieldbus.sim.faults.kinds import PositionStuck as PositionStuck
from haptic_fieldbus.sim.faults.kinds import SafeTorqueOff as SafeTorqueOff
from haptic_fieldbus.sim.faults.kinds import SdoRefusal as SdoRefusal
from haptic_fieldbus.sim.faults.kinds import Silence as Silence
from haptic_fieldbus.sim.faults.kinds import SlowCompute as SlowCompute
from haptic_fieldbus.sim.faults.kinds import SyncIgnored as SyncIgnored
from haptic_fieldbus.sim.faults.kinds import TorqueDead as TorqueDead
from haptic_fieldbus.sim.faults.kinds import TorqueReversed as TorqueReversed
from haptic_fieldbus.sim.faults.kinds import TorqueSaturated as TorqueSaturated
from haptic_fieldbus.sim.faults.kinds import WrongIdentity as WrongIdentity
