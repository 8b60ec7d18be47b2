"""The CANopen master: configuration by SDO, exchange by SYNC and PDOs."""
