"""The data link layer of CAN: frames and their bits, the wire with its arbitration, the controller of a program."""
