"""What the hand feels: elements, one a file, and ready scenes in `library/`."""
