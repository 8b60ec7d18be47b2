"""`python -m haptic_fieldbus`: the same as the command `haptic-fieldbus`."""

from haptic_fieldbus.cli import main

if __name__ == "__main__":
    main()
