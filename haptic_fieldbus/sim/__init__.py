"""The simulated world in virtual time: motor and hand, CiA 402 drive, CAN wire. All but `bus` and `world` is pure."""
