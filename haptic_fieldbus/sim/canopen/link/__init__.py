"""The data link layer of CAN: frames and their bits, the wire with its arbitration, a program's controller."""
