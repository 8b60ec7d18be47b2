"""Three loops by hand, each with every guard of the cycle: a wall, a virtual mass, and a shaft between two handles.

Each is one function without any choice, as somebody would write it for this scene on this drive alone. A guard that
needs a longer answer in the cycle only ends the run here.
"""

import math
import struct
from collections import deque
from collections.abc import Callable

ONE, TWO = struct.Struct("<qIHHHih"), struct.Struct("<qIHHIHHHihHih")
"""Images of one axis, and of two."""
UNIT, EFFORT_UNIT = 0.05 / 4096, 0.4 / 1000 / (0.05 / (2 * math.pi))
"""One encoder count [m], and one step of torque [N]."""
LATE, LATER = math.exp(-0.4e-3 * 2 * math.pi * 1000), math.exp(-0.6e-3 * 2 * math.pi * 1000)
"""Shares of a torque that are left after the time of the older, and of the newer target in a period."""
Loop = tuple[Callable[[bytes], bytearray], Callable[[], str]]
"""Function from an input image to an output image; and the guard that tripped, or ""."""


def sign_watch() -> Callable[[float, float], bool]:
    """Return a function of the mean torque and the place of a block: whether the motion goes against the torque."""
    places: deque[float] = deque(maxlen=5)
    torques: deque[float] = deque(maxlen=4)
    agreement = excitation = 0.0

    def opposed(torque: float, here: float) -> bool:
        nonlocal agreement, excitation
        torques.append(torque)
        places.append(here)
        if len(places) < 5:
            return False
        oldest, old, _, new, newest = places
        inertial = 2000.0 * (newest - 2.0 * new + 2.0 * old - oldest)
        first, second, third, fourth = torques
        change = 0.5 * (fourth + third - second - first)
        agreement = 0.95 * agreement + inertial * change
        excitation = 0.95 * excitation + change * change
        return excitation > 100.0 and agreement < -0.5 * excitation

    return opposed


def wall() -> Loop:
    """Return the loop of the wall of the library."""
    unpack, unit, effort_unit, late, later = ONE.unpack_from, UNIT, EFFORT_UNIT, LATE, LATER
    pack_into = struct.Struct("<Hh").pack_into
    lowest, highest, zero, missing, doubt, cap, shift = -0.1, 0.1, 0, 0, False, math.inf, 0.0
    pulses: Callable[[float], float] | None = None
    target = older = side = moved_ns = fresh_ns = total = 0
    left, position, way, energy, torque, before, fade = 5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    sent: deque[int] = deque([0] * 3, maxlen=3)
    opposed, tripped, output = sign_watch(), "", bytearray(4)

    def released(guard: str) -> bytearray:
        nonlocal tripped
        tripped = tripped or guard
        output[:] = bytes(len(output))
        return output

    def period(image: bytes) -> bytearray:
        nonlocal before, position, fade, target, older, torque, way, moved_ns, energy, side, fresh_ns, total, left
        if tripped:
            return released(tripped)
        t_ns, age_ns, flags, _, statusword, counts, shown = unpack(image)
        # Link flags and missing samples.
        if flags or missing:
            return released("link")
        # A sample in time.
        if fresh_ns and not 500_000 < t_ns - fresh_ns < 1_500_000:
            return released("time of the sample")
        if age_ns > 30_000_000:
            return released("age of the sample")
        fresh_ns = t_ns
        # Power state.
        if statusword & 0x6F != 0x27:
            return released("power state")
        # The encoder's wrap.
        counts -= zero
        if not -0x8000_0000 <= counts <= 0x7FFF_FFFF:
            counts = (counts + 0x8000_0000 & 0xFFFF_FFFF) - 0x8000_0000
        here = counts * unit
        moved = here - position
        # Speed, workspace, acceleration.
        if not (-0.01 <= moved <= 0.01 and lowest <= here <= highest):
            return released("speed or place")
        if not -0.001 <= moved - way <= 0.001:
            return released("acceleration")
        way, position = moved, here
        if moved:
            # Energy of the contact.
            moved_ns = t_ns
            energy += moved * (effort_unit * (0.56 * older + 0.44 * target) - 635.0 * moved)
            if energy > 0.0056:
                return released("energy")
        elif t_ns - moved_ns > 90_000_000_000:
            return released("stall")
        if target * side <= 0:
            energy, side = 0.0, target
        # The echo of the set-point, and the targets it may still show.
        torque = target + (older + (torque - older) * late - target) * later
        if (doubt or not -30.0 <= shown - torque <= 30.0) and fade >= 1.0:
            return released("echo")
        sent.appendleft(target)
        # The law, at the place where it is after gaps.
        place = here - shift
        force = -600.0 * (place - 0.02) if place > 0.02 else 0.0
        if not -math.inf < force < math.inf:
            return released("force")
        # Fade-in of the limit, effort, cap, pulses of a test, slew.
        if fade < 1.0:
            fade = min(1.0, fade + 0.002)
            force = max(-50.0 * fade, min(50.0 * fade, force))
        if not -50.0 <= force <= 50.0:
            force = 50.0 if force > 50.0 else -50.0
        if not -cap <= force <= cap:
            force = cap if force > cap else -cap
        if pulses is not None:
            force = pulses(force)
        if not -10.0 <= force - before <= 10.0:
            force = before + (10.0 if force > before else -10.0)
        before, older = force, target
        target = round(force / effort_unit)
        pack_into(output, 0, 0x0F, target)
        # Sign watch, in blocks of five periods.
        if not left:
            if opposed(total / 5, here):
                return released("sign")
            total, left = 0, 5
        total += target
        left -= 1
        return output

    return period, lambda: tripped


def mass(stiffness: float, weight: float) -> Loop:
    """Return the loop of a mass [kg] on a spring [N/m] whose other end is the handle; it begins at rest at 0.

    For a handle on a straight line between two samples the step is exact: the length of the spring is an oscillation
    about 0. The energy account takes the force of the law by the trapezoidal rule.
    """
    unpack, unit, effort_unit, late, later = ONE.unpack_from, UNIT, EFFORT_UNIT, LATE, LATER
    pack_into = struct.Struct("<Hh").pack_into
    lowest, highest, zero, missing, doubt, cap, shift = -0.1, 0.1, 0, 0, False, math.inf, 0.0
    pulses: Callable[[float], float] | None = None
    target = older = moved_ns = fresh_ns = silent = 0
    position = way = energy = torque = before = fade = length = speed = last = side = pending = 0.0
    sent: deque[int] = deque([0] * 3, maxlen=3)
    tripped, output = "", bytearray(4)
    phase = math.sqrt(stiffness / weight)
    cosine, sine, turned = math.cos(1e-3 * phase), math.sin(1e-3 * phase) / phase, math.sin(1e-3 * phase) * phase

    def released(guard: str) -> bytearray:
        nonlocal tripped
        tripped = tripped or guard
        output[:] = bytes(len(output))
        return output

    def period(image: bytes) -> bytearray:
        nonlocal before, position, fade, target, older, torque, way, moved_ns, energy, side, fresh_ns, silent
        nonlocal length, speed, last, pending
        if tripped:
            return released(tripped)
        t_ns, age_ns, flags, _, statusword, counts, shown = unpack(image)
        # Link flags and missing samples.
        if flags or missing:
            return released("link")
        # A sample in time.
        if fresh_ns and not 500_000 < t_ns - fresh_ns < 1_500_000:
            return released("time of the sample")
        if age_ns > 30_000_000:
            return released("age of the sample")
        fresh_ns = t_ns
        # Power state.
        if statusword & 0x6F != 0x27:
            return released("power state")
        # The encoder's wrap.
        counts -= zero
        if not -0x8000_0000 <= counts <= 0x7FFF_FFFF:
            counts = (counts + 0x8000_0000 & 0xFFFF_FFFF) - 0x8000_0000
        here = counts * unit
        moved = here - position
        # Speed, workspace, acceleration.
        if not (-0.01 <= moved <= 0.01 and lowest <= here <= highest):
            return released("speed or place")
        if not -0.001 <= moved - way <= 0.001:
            return released("acceleration")
        way, position = moved, here
        if moved:
            moved_ns = t_ns
        elif t_ns - moved_ns > 90_000_000_000:
            return released("stall")
        # Energy of the contact, by the force of the law.
        pulled = stiffness * length
        energy += 0.5 * (last + pulled) * pending
        if energy > 0.0056:
            return released("energy")
        last, pending = pulled, moved
        if pulled * side <= 0.0:
            silent = 0 if pulled or moved else silent + 1
            energy, side = 0.0 if silent > 400 else min(energy, 0.0), pulled
        # The echo of the set-point, and the targets it may still show.
        torque = target + (older + (torque - older) * late - target) * later
        if (doubt or not -30.0 <= shown - torque <= 30.0) and fade >= 1.0:
            return released("echo")
        sent.appendleft(target)
        # The law, at the place where it is after gaps.
        drawn = (moved - shift) * 1000.0
        apart = speed - drawn
        length, speed = cosine * length + sine * apart, drawn + cosine * apart - turned * length
        force = stiffness * length
        if not -math.inf < force < math.inf:
            return released("force")
        # Fade-in of the limit, effort, cap, pulses of a test, slew.
        if fade < 1.0:
            fade = min(1.0, fade + 0.002)
            force = max(-50.0 * fade, min(50.0 * fade, force))
        if not -50.0 <= force <= 50.0:
            force = 50.0 if force > 50.0 else -50.0
        if not -cap <= force <= cap:
            force = cap if force > cap else -cap
        if pulses is not None:
            force = pulses(force)
        if not -10.0 <= force - before <= 10.0:
            force = before + (10.0 if force > before else -10.0)
        before, older = force, target
        target = round(force / effort_unit)
        pack_into(output, 0, 0x0F, target)
        return output

    return period, lambda: tripped


def shaft() -> Loop:
    """Return the loop of the library's virtual shaft, with the wall at its right handle."""
    unpack, unit, effort_unit, late, later = TWO.unpack_from, UNIT, EFFORT_UNIT, LATE, LATER
    pack_into = struct.Struct("<HhHh").pack_into
    lowest, highest, missing, left_zero, right_zero, left_doubt, right_doubt = -0.1, 0.1, 0, 0, 0, False, False
    left_cap, right_cap, left_shift, right_shift = math.inf, math.inf, 0.0, 0.0
    left_pulses: Callable[[float], float] | None = None
    right_pulses: Callable[[float], float] | None = None
    left_target = right_target = left_older = right_older = left_side = right_side = left_moved_ns = right_moved_ns = 0
    fresh_ns = left_total = right_total = 0
    left_left = right_left = 5
    left_position = right_position = left_way = right_way = left_torque = right_torque = energy = 0.0
    left_before = right_before = left_fade = right_fade = 0.0
    left_sent: deque[int] = deque([0] * 3, maxlen=3)
    right_sent: deque[int] = deque([0] * 3, maxlen=3)
    left_opposed, right_opposed, tripped, output = sign_watch(), sign_watch(), "", bytearray(8)

    def released(guard: str) -> bytearray:
        nonlocal tripped
        tripped = tripped or guard
        output[:] = bytes(len(output))
        return output

    def period(image: bytes) -> bytearray:
        nonlocal left_position, right_position, left_way, right_way, left_torque, right_torque, energy, fresh_ns
        nonlocal left_target, right_target, left_older, right_older, left_side, right_side
        nonlocal left_moved_ns, right_moved_ns
        nonlocal left_before, right_before, left_fade, right_fade, left_total, right_total, left_left, right_left
        if tripped:
            return released(tripped)
        (
            t_ns, left_age_ns, left_flags, _, right_age_ns, right_flags, _,
            left_word, left_counts, left_shown, right_word, right_counts, right_shown,
        ) = unpack(image)  # fmt: skip
        # Link flags and missing samples.
        if left_flags or right_flags or missing:
            return released("link")
        # Samples in time.
        if fresh_ns and not 500_000 < t_ns - fresh_ns < 1_500_000:
            return released("time of the samples")
        if left_age_ns > 30_000_000 or right_age_ns > 30_000_000:
            return released("age of the samples")
        fresh_ns = t_ns
        # Left.
        # Power state.
        if left_word & 0x6F != 0x27:
            return released("power state")
        # The encoder's wrap.
        left_counts -= left_zero
        if not -0x8000_0000 <= left_counts <= 0x7FFF_FFFF:
            left_counts = (left_counts + 0x8000_0000 & 0xFFFF_FFFF) - 0x8000_0000
        left_here = left_counts * unit
        left_moved = left_here - left_position
        # Speed, workspace, acceleration.
        if not (-0.01 <= left_moved <= 0.01 and lowest <= left_here <= highest):
            return released("speed or place")
        if not -0.001 <= left_moved - left_way <= 0.001:
            return released("acceleration")
        left_way, left_position = left_moved, left_here
        # Right.
        # Power state.
        if right_word & 0x6F != 0x27:
            return released("power state")
        # The encoder's wrap.
        right_counts -= right_zero
        if not -0x8000_0000 <= right_counts <= 0x7FFF_FFFF:
            right_counts = (right_counts + 0x8000_0000 & 0xFFFF_FFFF) - 0x8000_0000
        right_here = right_counts * unit
        right_moved = right_here - right_position
        # Speed, workspace, acceleration.
        if not (-0.01 <= right_moved <= 0.01 and lowest <= right_here <= highest):
            return released("speed or place")
        if not -0.001 <= right_moved - right_way <= 0.001:
            return released("acceleration")
        right_way, right_position = right_moved, right_here
        # Energy of the contact.
        if left_moved:
            left_moved_ns = t_ns
            energy += left_moved * (effort_unit * (0.96 * left_older + 0.04 * left_target) - 875.0 * left_moved)
        if right_moved:
            right_moved_ns = t_ns
            energy += right_moved * (effort_unit * (0.96 * right_older + 0.04 * right_target) - 1313.0 * right_moved)
        if energy > 0.0056:
            return released("energy")
        if t_ns - left_moved_ns > 90_000_000_000 or t_ns - right_moved_ns > 90_000_000_000:
            return released("stall")
        if left_target * left_side <= 0 and right_target * right_side <= 0:
            energy, left_side, right_side = 0.0, left_target, right_target
        # The echo of the set-point, and the targets it may still show.
        left_torque = left_target + (left_older + (left_torque - left_older) * late - left_target) * later
        if (left_doubt or not -30.0 <= left_shown - left_torque <= 30.0) and left_fade >= 1.0:
            return released("echo")
        left_sent.appendleft(left_target)
        # The echo of the set-point, and the targets it may still show.
        right_torque = right_target + (right_older + (right_torque - right_older) * late - right_target) * later
        if (right_doubt or not -30.0 <= right_shown - right_torque <= 30.0) and right_fade >= 1.0:
            return released("echo")
        right_sent.appendleft(right_target)
        # The laws, at the places where they are after gaps.
        left_place, right_place = left_here - left_shift, right_here - right_shift
        left_force = -300.0 * (left_place - right_place) - 300.0 * (left_moved - right_moved)  # 0.3 N·s/m within 1 ms
        right_force = -left_force
        if right_place > 0.02:
            right_force += -300.0 * (right_place - 0.02)
        if not -math.inf < left_force < math.inf:
            return released("force")
        # Fade-in of the limit, effort, cap, pulses of a test, slew.
        if left_fade < 1.0:
            left_fade = min(1.0, left_fade + 0.002)
            left_force = max(-50.0 * left_fade, min(50.0 * left_fade, left_force))
        if not -50.0 <= left_force <= 50.0:
            left_force = 50.0 if left_force > 50.0 else -50.0
        if not -left_cap <= left_force <= left_cap:
            left_force = left_cap if left_force > left_cap else -left_cap
        if left_pulses is not None:
            left_force = left_pulses(left_force)
        if not -10.0 <= left_force - left_before <= 10.0:
            left_force = left_before + (10.0 if left_force > left_before else -10.0)
        left_before, left_older = left_force, left_target
        left_target = round(left_force / effort_unit)
        if not -math.inf < right_force < math.inf:
            return released("force")
        # Fade-in of the limit, effort, cap, pulses of a test, slew.
        if right_fade < 1.0:
            right_fade = min(1.0, right_fade + 0.002)
            right_force = max(-50.0 * right_fade, min(50.0 * right_fade, right_force))
        if not -50.0 <= right_force <= 50.0:
            right_force = 50.0 if right_force > 50.0 else -50.0
        if not -right_cap <= right_force <= right_cap:
            right_force = right_cap if right_force > right_cap else -right_cap
        if right_pulses is not None:
            right_force = right_pulses(right_force)
        if not -10.0 <= right_force - right_before <= 10.0:
            right_force = right_before + (10.0 if right_force > right_before else -10.0)
        right_before, right_older = right_force, right_target
        right_target = round(right_force / effort_unit)
        pack_into(output, 0, 0x0F, left_target, 0x0F, right_target)
        # Sign watch, in blocks of five periods.
        if not left_left:
            if left_opposed(left_total / 5, left_here):
                return released("sign")
            left_total, left_left = 0, 5
        left_total += left_target
        left_left -= 1
        # Sign watch, in blocks of five periods.
        if not right_left:
            if right_opposed(right_total / 5, right_here):
                return released("sign")
            right_total, right_left = 0, 5
        right_total += right_target
        right_left -= 1
        return output

    return period, lambda: tripped
