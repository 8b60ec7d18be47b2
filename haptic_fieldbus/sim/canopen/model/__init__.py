"""The node of one model of drive: its PDOs, its quirks, the file of its vendor."""
