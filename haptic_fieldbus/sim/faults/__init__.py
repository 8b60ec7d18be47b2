"""Faults of a simulated bench, as data: the kinds of `[[fault]]` in a TOML file.

`at` [s] counts from *operation enabled*, anew when a drive is enabled again before anything has happened; faults
without it exist from power-on. `node` is the node-ID of the drive, None every drive of the bus; `bus` is a bus of the
rig, None every bus. `duration` [s] None is for ever.
"""

from haptic_fieldbus.sim.faults.answers import AnswerCorrupted as AnswerCorrupted
from haptic_fieldbus.sim.faults.answers import AnswerDelayed as AnswerDelayed
from haptic_fieldbus.sim.faults.answers import AnswerDisturbance as AnswerDisturbance
from haptic_fieldbus.sim.faults.answers import AnswerException as AnswerException
from haptic_fieldbus.sim.faults.answers import AnswerFault as AnswerFault
from haptic_fieldbus.sim.faults.answers import AnswerGarbage as AnswerGarbage
from haptic_fieldbus.sim.faults.answers import AnswerLost as AnswerLost
from haptic_fieldbus.sim.faults.answers import AnswerSwapped as AnswerSwapped
from haptic_fieldbus.sim.faults.answers import AnswerTruncated as AnswerTruncated
from haptic_fieldbus.sim.faults.answers import AnswerWrongUnit as AnswerWrongUnit
from haptic_fieldbus.sim.faults.answers import ConnectionReset as ConnectionReset
from haptic_fieldbus.sim.faults.answers import ForeignSetPoints as ForeignSetPoints
from haptic_fieldbus.sim.faults.answers import LineDisturbance as LineDisturbance
from haptic_fieldbus.sim.faults.concern import Concern as Concern
from haptic_fieldbus.sim.faults.drive import DeadGuard as DeadGuard
from haptic_fieldbus.sim.faults.drive import DriveFault as DriveFault
from haptic_fieldbus.sim.faults.drive import DriveFaultKind as DriveFaultKind
from haptic_fieldbus.sim.faults.drive import DuplicateNode as DuplicateNode
from haptic_fieldbus.sim.faults.drive import Emergency as Emergency
from haptic_fieldbus.sim.faults.drive import EncoderJump as EncoderJump
from haptic_fieldbus.sim.faults.drive import EncoderReversed as EncoderReversed
from haptic_fieldbus.sim.faults.drive import EncoderScaling as EncoderScaling
from haptic_fieldbus.sim.faults.drive import HeartbeatLost as HeartbeatLost
from haptic_fieldbus.sim.faults.drive import LastingFault as LastingFault
from haptic_fieldbus.sim.faults.drive import MissingNode as MissingNode
from haptic_fieldbus.sim.faults.drive import MissingRpdos as MissingRpdos
from haptic_fieldbus.sim.faults.drive import MissingTpdos as MissingTpdos
from haptic_fieldbus.sim.faults.drive import NodeReset as NodeReset
from haptic_fieldbus.sim.faults.drive import PositionStuck as PositionStuck
from haptic_fieldbus.sim.faults.drive import SafeTorqueOff as SafeTorqueOff
from haptic_fieldbus.sim.faults.drive import SdoRefusal as SdoRefusal
from haptic_fieldbus.sim.faults.drive import Silence as Silence
from haptic_fieldbus.sim.faults.drive import SyncIgnored as SyncIgnored
from haptic_fieldbus.sim.faults.drive import TorqueDead as TorqueDead
from haptic_fieldbus.sim.faults.drive import TorqueReversed as TorqueReversed
from haptic_fieldbus.sim.faults.drive import TorqueSaturated as TorqueSaturated
from haptic_fieldbus.sim.faults.drive import WrongIdentity as WrongIdentity
from haptic_fieldbus.sim.faults.file import Fault as Fault
from haptic_fieldbus.sim.faults.file import FaultFile as FaultFile
from haptic_fieldbus.sim.faults.file import TimedFault as TimedFault
from haptic_fieldbus.sim.faults.file import faults_of as faults_of
from haptic_fieldbus.sim.faults.file import faults_on as faults_on
from haptic_fieldbus.sim.faults.file import kinds_of as kinds_of
from haptic_fieldbus.sim.faults.file import load_faults as load_faults
from haptic_fieldbus.sim.faults.file import toml_of as toml_of
from haptic_fieldbus.sim.faults.frames import BusOff as BusOff
from haptic_fieldbus.sim.faults.frames import Disturbance as Disturbance
from haptic_fieldbus.sim.faults.frames import ErrorFrame as ErrorFrame
from haptic_fieldbus.sim.faults.frames import ForeignFrame as ForeignFrame
from haptic_fieldbus.sim.faults.frames import FrameDelayed as FrameDelayed
from haptic_fieldbus.sim.faults.frames import FrameDropped as FrameDropped
from haptic_fieldbus.sim.faults.frames import FrameDuplicated as FrameDuplicated
from haptic_fieldbus.sim.faults.frames import FrameGroup as FrameGroup
from haptic_fieldbus.sim.faults.frames import FrameWrongLength as FrameWrongLength
from haptic_fieldbus.sim.faults.frames import FrameWrongNode as FrameWrongNode
from haptic_fieldbus.sim.faults.frames import InterfaceDown as InterfaceDown
from haptic_fieldbus.sim.faults.frames import LineFault as LineFault
from haptic_fieldbus.sim.faults.host import ClockStep as ClockStep
from haptic_fieldbus.sim.faults.host import HandFault as HandFault
from haptic_fieldbus.sim.faults.host import HandHit as HandHit
from haptic_fieldbus.sim.faults.host import HandRelease as HandRelease
from haptic_fieldbus.sim.faults.host import HostFault as HostFault
from haptic_fieldbus.sim.faults.host import HostLate as HostLate
from haptic_fieldbus.sim.faults.host import HostPaused as HostPaused
from haptic_fieldbus.sim.faults.host import SlowCompute as SlowCompute
