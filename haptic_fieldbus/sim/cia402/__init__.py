"""The motion half of a simulated drive (CiA 402-2): automaton, objects, power stage, modes of operation."""
