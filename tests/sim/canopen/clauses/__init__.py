"""What the standards say, as conversations between a master and a drive; written apart from the drive."""
