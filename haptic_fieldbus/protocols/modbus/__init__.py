"""Modbus, RTU and TCP: registers of a drive, what is exchanged in a period, and what it takes."""
