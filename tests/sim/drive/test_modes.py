"""CiA 402-2, mode by mode and sentence by sentence: set-points, limits, windows, the mode's bits of the statusword."""

from tests.sim.drive.sentences import (
    COUNTS,
    ENABLE,
    HALT,
    RESET,
    SPEED_COUNTS,
    VOLTAGE_OFF,
    Clause,
    bits,
    clause,
    control,
    emergency,
    enabled,
    fault,
    mode,
    refused,
    run,
    shows,
    state,
    table,
    turning,
    write,
)

PP, PV, TQ, HM, CSP, CSV, CST = 1, 3, 4, 6, 8, 9, 10
REACHED, LIMITED, BIT_12, BIT_13 = 0x0400, 0x0800, 0x1000, 0x2000
NEW, IMMEDIATELY, RELATIVE = ENABLE | 0x10, ENABLE | 0x30, ENABLE | 0x50

TORQUE_ROWS = [
    clause("cst: the demand is target torque plus torque offset, at once",
           enabled(CST), write(0x6071, 50), write(0x60B2, 25), shows(0x6074, 75), run(5), shows(0x6077, 75)),
    clause("cst: bit 12 says that the drive follows the command value",
           mode(CST), bits(BIT_12, 0), enabled(CST), bits(BIT_12, BIT_12), control(VOLTAGE_OFF), bits(BIT_12, 0)),
    *(clause(f"{limit:04X}h limits torque {'up' if sign > 0 else 'down'}, bit 11 says so",
             write(limit, 30), enabled(CST), write(0x6071, 31 * sign), shows(0x6074, 30 * sign),
             bits(LIMITED, LIMITED), write(0x6071, 30 * sign), bits(LIMITED, 0), write(limit, 29),
             shows(0x6074, 29 * sign), bits(LIMITED, LIMITED))
      for limit, signs in ((0x6072, (1, -1)), (0x6073, (1, -1)), (0x60E0, (1,)), (0x60E1, (-1,))) for sign in signs),
    clause("60E0h does not limit downwards, 60E1h not upwards",
           write(0x60E0, 10), enabled(CST), write(0x6071, -31), shows(0x6074, -31), write(0x60E0, 40),
           write(0x60E1, 10), write(0x6071, 31), shows(0x6074, 31)),
    clause("6072h = 0: no torque", write(0x6072, 0), enabled(CST), write(0x6071, 100), run(5), shows(0x6077, 0)),
    clause("6078h is told in ‰ of rated current, which makes rated torque; 6075h is in mA",
           enabled(CST), write(0x6071, 80), run(5), shows(0x6078, 80), shows(0x6075, 2500), rated_current=2.5),
    clause("tq: the demand goes to the target by the torque slope, bit 10 when it is there",
           write(0x6087, 1000), enabled(TQ), bits(REACHED, REACHED), write(0x6071, 100), bits(REACHED, 0),
           run(50), shows(0x6074, 50, 1), bits(REACHED, 0), run(51), shows(0x6074, 100), bits(REACHED, REACHED),
           write(0x6071, -20), run(60), shows(0x6074, 40, 1), run(61), shows(0x6074, -20), bits(REACHED, REACHED)),
    clause("tq: a limited target is approached up to the limit",
           write(0x6072, 40), enabled(TQ), write(0x6071, 100), run(10), shows(0x6074, 40),
           bits(REACHED | LIMITED, REACHED | LIMITED)),
    clause("tq: the slope is taken over while it acts; 0 is no slope",
           write(0x6087, 100), enabled(TQ), write(0x6071, 100), run(50), shows(0x6074, 5, 1), write(0x6087, 0), run(1),
           shows(0x6074, 100)),
    clause("tq: halt brings the axis to rest, bit 10 then tells standstill; torque goes on afterwards",
           enabled(TQ), write(0x6071, 100), run(50), control(HALT), bits(REACHED, 0), run(300),
           bits(REACHED, REACHED), shows(0x606C, 0, 130), control(ENABLE), run(10), shows(0x6074, 100)),
    clause("tq: 6088h knows the linear ramp only", write(0x6088, 0), refused(0x6088, 1, 0x0609_0030)),
    clause("from one torque mode to the other the demand goes on where it is",
           enabled(CST), write(0x6071, 100), write(0x6087, 1000), mode(TQ), write(0x6071, 0), run(50),
           shows(0x6074, 50, 1)),
]  # fmt: skip


@table(TORQUE_ROWS)
def test_torque_modes(row: Clause) -> None:
    row.show()


TARGET, RAMP = 10_000, 100_000
VELOCITY = (write(0x6083, RAMP), write(0x6084, 2 * RAMP), write(0x606D, 50), write(0x606F, 50))
VELOCITY_ROWS = [
    clause("pv: the demand grows by the profile acceleration, the axis follows, bit 10 tells that it is there",
           *VELOCITY, enabled(PV), write(0x60FF, TARGET), run(50), shows(0x606B, 5000, 50), shows(0x606C, 5000, 100),
           bits(REACHED, 0), run(70), shows(0x606B, TARGET), shows(0x606C, TARGET, 20), bits(REACHED, REACHED)),
    clause("pv: it falls by the profile deceleration, through zero with both",
           *VELOCITY, enabled(PV), write(0x60FF, TARGET), run(150), write(0x60FF, -TARGET), run(25),
           shows(0x606B, 5000, 100), run(75), shows(0x606B, -5000, 100), run(60), shows(0x606C, -TARGET, 20)),
    clause("pv: bit 12 tells standstill", *VELOCITY, enabled(PV), run(10), bits(BIT_12, BIT_12),
           write(0x60FF, TARGET), run(20), bits(BIT_12, 0), write(0x60FF, 0), run(100), bits(BIT_12, BIT_12)),
    clause("pv: 606Eh, the target counts as reached when it has been in the window for that time",
           *VELOCITY, write(0x606E, 40), enabled(PV), write(0x60FF, TARGET), run(130), bits(REACHED, 0), run(20),
           bits(REACHED, REACHED)),
    clause("pv: 6070h, bit 12 falls when the threshold has been exceeded for that time",
           *VELOCITY, write(0x6070, 40), enabled(PV), run(5), write(0x60FF, TARGET), run(35), bits(BIT_12, BIT_12),
           run(10), bits(BIT_12, 0)),
    *(clause(f"pv: {limit:04X}h limits the speed, bit 11 says so",
             *VELOCITY, write(limit, value), enabled(PV), write(0x60FF, TARGET), run(200), shows(0x606C, 4096, 20),
             bits(REACHED | LIMITED, LIMITED)) for limit, value in ((0x607F, 4096), (0x6080, 60))),
    clause("pv: halt slows down, bits 10 and 12 tell standstill, and the speed is resumed",
           *VELOCITY, enabled(PV), write(0x60FF, TARGET), run(150), control(HALT), run(25), shows(0x606C, 5000, 200),
           bits(REACHED | BIT_12, 0), run(100), bits(REACHED | BIT_12, REACHED | BIT_12), shows(0x606C, 0, 130),
           control(ENABLE), run(50), shows(0x606B, 5000, 100), run(100), shows(0x606C, TARGET, 20)),
    turning("pv: the profile begins at the speed that the axis has", *VELOCITY, write(0x60FF, 0), enabled(PV),
            run(100), shows(0x606B, SPEED_COUNTS - 2 * RAMP * 0.1, 100)),
    clause("csv: the demand is target plus velocity offset, at once; bit 12 says that it is followed",
           enabled(CSV), write(0x60FF, 4000), write(0x60B1, 1000), bits(BIT_12, BIT_12), run(100),
           shows(0x606B, 5000), shows(0x606C, 5000, 5)),
    clause("csv: 6080h limits it, bit 11 says so",
           write(0x6080, 60), enabled(CSV), write(0x60FF, -TARGET), run(100), shows(0x606C, -4096, 5),
           bits(LIMITED, LIMITED)),
    clause("csv: the torque offset is fed forward",
           write(0x6072, 200), enabled(CSV), write(0x60B2, 500), run(1), shows(0x6074, 200), bits(LIMITED, LIMITED)),
    clause("6083h, 6084h, 6085h: a ramp of 0 is not limited",
           write(0x6083, 0), enabled(PV), write(0x60FF, TARGET), run(1), shows(0x606B, TARGET)),
    clause("6086h knows the linear ramp only", write(0x6086, 0), refused(0x6086, 3, 0x0609_0030)),
]  # fmt: skip


@table(VELOCITY_ROWS)
def test_velocity_modes(row: Clause) -> None:
    row.show()


# One turn in 0.3 s: a tenth up, a tenth at 20480 counts/s, a tenth down.
WAY = (write(0x6081, 20_480), write(0x6083, 204_800), write(0x6084, 204_800), write(0x6067, 3))
POSITION_ROWS = [
    clause("pp: bit 4 hands a set-point over, bit 12 acknowledges it, and falls after bit 4",
           *WAY, enabled(PP), bits(BIT_12, 0), write(0x607A, COUNTS), control(NEW), bits(BIT_12, BIT_12), run(5),
           bits(BIT_12, BIT_12), control(ENABLE), bits(BIT_12, 0)),
    clause("pp: a trapezium by profile velocity, acceleration and deceleration",
           *WAY, enabled(PP), write(0x607A, COUNTS), control(NEW), run(100), shows(0x6062, 1024, 10),
           shows(0x6064, 1024, 20), run(50), shows(0x6062, 2048, 10), bits(REACHED, 0), run(100),
           shows(0x6062, 3840, 10), run(60), shows(0x6064, COUNTS, 2), bits(REACHED, REACHED)),
    clause("pp: a short way is a triangle",
           *WAY, enabled(PP), write(0x607A, -512), control(NEW), run(50), shows(0x6062, -256, 6), run(60),
           shows(0x6064, -512, 2), bits(REACHED, REACHED)),
    clause("pp: without bit 5 a second set-point waits, bit 12 stays until it is under way, a third is not taken",
           *WAY, enabled(PP), write(0x607A, COUNTS), control(NEW, ENABLE), run(50), write(0x607A, 0), control(NEW),
           bits(BIT_12, BIT_12), control(ENABLE), bits(BIT_12, BIT_12), write(0x607A, 999), control(NEW, ENABLE),
           bits(BIT_12, BIT_12), run(240), shows(0x6062, COUNTS, 10), run(20), bits(BIT_12, 0), run(310),
           shows(0x6064, 0, 2), bits(REACHED, REACHED)),
    clause("pp: bit 12 waits for bit 4 also when the waiting set-point is taken",
           *WAY, enabled(PP), write(0x607A, 512), control(NEW, ENABLE), write(0x607A, 0), control(NEW), run(130),
           bits(BIT_12, BIT_12), control(ENABLE), bits(BIT_12, 0)),
    clause("pp: bit 5, change set immediately, replaces what is under way and what waits",
           *WAY, enabled(PP), write(0x607A, 2 * COUNTS), control(NEW, ENABLE), write(0x607A, 3 * COUNTS),
           control(NEW, ENABLE), run(150), write(0x607A, 0), control(IMMEDIATELY), bits(BIT_12, BIT_12),
           control(ENABLE), bits(BIT_12, 0), run(600), shows(0x6064, 0, 2), bits(REACHED, REACHED)),
    clause("pp: bit 6, relative to the target before it",
           *WAY, enabled(PP), write(0x607A, 512), control(RELATIVE, ENABLE), run(5), control(RELATIVE, ENABLE),
           run(300), shows(0x6064, 1024, 2), control(RELATIVE | 0x20, ENABLE), run(200), shows(0x6064, 1536, 2)),
    clause("pp: 6068h, the target counts as reached when the axis has been in the window for that time",
           *WAY, write(0x6068, 50), enabled(PP), write(0x607A, COUNTS), control(NEW, ENABLE), run(330),
           bits(REACHED, 0), run(40), bits(REACHED, REACHED)),
    clause("pp: 6067h = FFFF FFFFh is no window: reached at the end of the profile",
           *WAY, write(0x6067, 0xFFFF_FFFF), write(0x6072, 0), enabled(PP), write(0x607A, COUNTS), control(NEW),
           run(295), bits(REACHED, 0), run(10), bits(REACHED, REACHED)),
    clause("pp: 607Fh limits the profile velocity, bit 11 says so",
           *WAY, write(0x607F, 10_240), enabled(PP), write(0x607A, COUNTS), control(NEW, ENABLE), run(200),
           bits(LIMITED, LIMITED), shows(0x6062, 0.025 * 10_240 + 0.15 * 10_240, 10), run(300),
           shows(0x6064, COUNTS, 2), bits(REACHED, REACHED)),
    clause("pp: halt stops on the way, bit 10 tells standstill, and the positioning goes on",
           *WAY, enabled(PP), write(0x607A, COUNTS), control(NEW, ENABLE), run(150), control(HALT), run(150),
           bits(REACHED, REACHED), shows(0x606C, 0, 130), shows(0x6064, 3072, 30), control(ENABLE), bits(REACHED, 0),
           run(200), shows(0x6064, COUNTS, 2), bits(REACHED, REACHED)),
    clause("pp: a profile velocity of 0 goes nowhere",
           *WAY, write(0x6081, 0), enabled(PP), write(0x607A, COUNTS), control(NEW, ENABLE), run(100),
           shows(0x6064, 0, 1)),
    turning("pp: on entering it the axis comes to rest on the deceleration and stays there",
            write(0x6084, round(SPEED_COUNTS / 0.1)), enabled(PP), run(300), shows(0x606C, 0, 5),
            shows(0x6064, SPEED_COUNTS * 0.05, 40), bits(REACHED, REACHED)),
    clause("pp: leaving operation enabled forgets the set-points",
           *WAY, enabled(PP), write(0x607A, COUNTS), control(NEW, ENABLE), run(50), control(VOLTAGE_OFF),
           bits(BIT_12 | REACHED, 0), enabled(PP), run(300), bits(REACHED, REACHED)),
    clause("csp: a target is reached linearly within the interpolation time",
           write(0x60C2, 10, subindex=1), enabled(CSP), bits(BIT_12, BIT_12), write(0x607A, 100), run(5),
           shows(0x6062, 50, 5), run(6), shows(0x6062, 100), run(200), shows(0x6064, 100)),
    clause("csp: the interpolation time has a power of ten",
           write(0x60C2, 5, subindex=1), write(0x60C2, -2, subindex=2, code="b"), enabled(CSP), write(0x607A, 100),
           run(25), shows(0x6062, 50, 1)),
    clause("csp: the position offset is added, the torque offset fed forward",
           write(0x60B0, 30), enabled(CSP), write(0x607A, 100), run(300), shows(0x6064, 130), write(0x6072, 300),
           write(0x60B2, 1000), run(1), shows(0x6074, 300), bits(LIMITED, LIMITED)),
    clause("csp: targets go through the end of INTEGER32",
           enabled(CSP), write(0x607A, 0x7FFF_FFFF), write(0x6080, 0), run(5), shows(0x6062, 0x7FFF_FFFF, 1)),
    clause("pp and csp: without torque there is a following error: bit 13 when it has lasted for 6066h",
           write(0x6065, 50), write(0x6066, 20), write(0x6072, 0), enabled(CSP), write(0x607A, 100), run(15),
           shows(0x60F4, 100), bits(BIT_13, 0), run(10), bits(BIT_13, BIT_13), state("operation enabled"),
           write(0x607A, 40), run(2), bits(BIT_13, 0), shows(0x60F4, 40)),
    clause("6065h = FFFF FFFFh switches following error control off",
           write(0x6072, 0), enabled(CSP), write(0x607A, 1_000_000), run(50), bits(BIT_13, 0)),
    clause("a following error may be a fault, as the settings of the drive say",
           write(0x605E, 0), write(0x6065, 50), write(0x6072, 0), enabled(PP), write(0x607A, COUNTS), control(NEW),
           run(300), state("fault"), shows(0x603F, 0x8611), control(RESET), state("switch on disabled"),
           following_error_faults=True),
]  # fmt: skip


@table(POSITION_ROWS)
def test_position_modes(row: Clause) -> None:
    row.show()


HOMING_ROWS = [
    clause("hm: bits 12 and 10 are 01 before it is started and 11 when it is complete",
           enabled(HM), bits(BIT_13 | BIT_12 | REACHED, REACHED), control(NEW), bits(0x3400, BIT_12 | REACHED)),
    *(clause(f"hm: method {method}: the zero position is the current position plus the home offset",
             write(0x6098, method), write(0x607C, 1000), enabled(HM), control(NEW), shows(0x6064, -1000), run(20),
             shows(0x6064, -1000), position=3.0) for method in (35, 37)),
    clause("hm: other methods are refused", refused(0x6098, 1, 0x0609_0030), refused(0x6098, 0, 0x0609_0030)),
    clause("hm: method 37 does not need operation enabled, method 35 does",
           write(0x6098, 35), mode(HM), control(0x10), shows(0x6064, 652, 1), control(0), write(0x6098, 37),
           control(0x10), shows(0x6064, 0), position=1.0),
    clause("hm: bit 4 has no effect in other modes", write(0x607C, 500), enabled(CST), control(NEW), shows(0x6064, 0)),
    clause("hm: a halted axis does not home until the halt is over",
           enabled(HM), control(HALT | 0x10), bits(BIT_12, 0), run(20), bits(REACHED, REACHED), control(NEW),
           bits(BIT_12, BIT_12)),
    clause("hm: positions afterwards count from the new zero",
           *WAY, write(0x607C, 1000), enabled(HM), control(NEW, ENABLE), mode(PP), write(0x607A, 0), control(NEW),
           run(400), shows(0x6064, 0, 2), position=3.0),
    turning("hm: the motor is brought to rest and held", enabled(HM), run(400), shows(0x606C, 0, 5)),
]  # fmt: skip


@table(HOMING_ROWS)
def test_homing(row: Clause) -> None:
    row.show()


FACTOR_ROWS = [
    clause("6092h: position units a turn of the driving shaft", write(0x6092, 3600, 1), shows(0x6064, 1800, 1),
           position=3.141592653589793),
    clause("6091h: motor turns a turn of the driving shaft", write(0x6091, 2, 1), shows(0x6064, 1024, 1),
           position=3.141592653589793),
    clause("608Fh: counts a turn of the motor", write(0x608F, 2 * COUNTS, 1), shows(0x6064, 1024, 1),
           position=3.141592653589793),
    turning("607Eh: bit 7 turns positions, bit 6 velocities", write(0x607E, 0x80), run(100),
            shows(0x6064, -0.1 * SPEED_COUNTS, 1), shows(0x606C, SPEED_COUNTS, 1), write(0x607E, 0x40),
            shows(0x6064, 0.1 * SPEED_COUNTS, 1), shows(0x606C, -SPEED_COUNTS, 1)),
    clause("pp in the units of the factors, with polarity",
           write(0x6092, 360, 1), write(0x607E, 0x80), write(0x6081, 3600), write(0x6083, 36_000),
           write(0x6084, 36_000), write(0x6067, 1), enabled(PP), write(0x607A, 180), control(NEW, ENABLE), run(200),
           shows(0x6064, 180, 1), bits(REACHED, REACHED), write(0x607E, 0), shows(0x6064, -180, 1)),
    clause("pv in the units of the factors, with polarity",
           write(0x6092, 360, 1), write(0x607E, 0x40), enabled(PV), write(0x60FF, 720), run(300), shows(0x606C, 720, 1),
           write(0x607E, 0), shows(0x606C, -720, 1)),
    clause("without feed constant the drive counts on the driving shaft",
           write(0x608F, 777, 1), write(0x6091, 2, 1), shows(0x6064, 1024, 1), position=3.141592653589793,
           without=frozenset((0x6092,))),
    clause("factors of 0 are refused", refused(0x608F, 0, 0x0609_0032, 1), refused(0x6092, 0, 0x0609_0032, 2)),
]  # fmt: skip


@table(FACTOR_ROWS)
def test_factors(row: Clause) -> None:
    row.show()


def test_a_following_error_that_is_a_fault_is_told_by_an_emergency() -> None:
    clause("", write(0x605E, 0), write(0x6065, 50), write(0x6072, 0), enabled(PP), write(0x607A, COUNTS), control(NEW),
           run(300), emergency(0x8611), following_error_faults=True).show()  # fmt: skip


def test_a_fault_in_a_ticking_mode_ends_the_ticks() -> None:
    clause("", write(0x605E, 0), enabled(PV), write(0x60FF, 1000), run(5), fault(), run(5), shows(0x6074, 0)).show()
