"""The CANopen half of a simulated drive (CiA 301, CiA 305): object dictionary and services, one file each."""
