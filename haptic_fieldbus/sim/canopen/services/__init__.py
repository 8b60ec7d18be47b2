"""The services of a CANopen node (CiA 301, CiA 305), one file each."""
