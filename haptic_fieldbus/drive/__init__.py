"""What a drive offers and how it is spoken to, without any I/O."""
