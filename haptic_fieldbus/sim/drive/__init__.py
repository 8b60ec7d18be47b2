"""A simulated drive (CiA 402-2), independent of its bus: dictionary, automaton, modes of operation, power stage."""
