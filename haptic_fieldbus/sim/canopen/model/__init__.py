"""What makes the node of one model of drive: its PDOs, its quirks, the file of its vendor."""
