"""Analysis that only the report reaches: many loops at once, limit cycles, schedules of samples, steps by rates."""
