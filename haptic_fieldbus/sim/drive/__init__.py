"""A simulated drive (CiA 402-2), whatever it is reached by: dictionary, automaton, modes of operation, power stage."""
