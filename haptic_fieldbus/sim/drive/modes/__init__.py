"""The modes of operation of the simulated drive, one file for each group."""
