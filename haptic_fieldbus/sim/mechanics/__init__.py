"""What turns, followed exactly between events: how a shaft moves, and what a rig may hang on it."""
