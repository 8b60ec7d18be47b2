"""Clauses of the standards, as conversations between a master and a drive; written apart from the drive."""
