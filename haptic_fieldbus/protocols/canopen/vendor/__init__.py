"""What the EDS of a vendor says of a drive, in the terms of a profile."""
