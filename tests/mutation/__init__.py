"""Small changes to what decides about torque, each of which a test must notice: `python -m tests.mutation`."""
