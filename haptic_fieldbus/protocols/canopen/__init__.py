"""CANopen (CiA 301, CiA 402) for planning: profiles, PDOs, bus load and delay."""
