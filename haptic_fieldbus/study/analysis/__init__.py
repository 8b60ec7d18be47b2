"""Analysis for the report alone: many loops at once, limit cycles, sampling schedules, nonlinear rates."""
