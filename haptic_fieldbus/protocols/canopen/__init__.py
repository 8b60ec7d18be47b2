"""CANopen (CiA 301, CiA 402) as a plan sees it: objects, PDOs, what they cost on the bus."""
