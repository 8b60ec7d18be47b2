"""The CANopen master."""
