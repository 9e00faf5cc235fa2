"""The C back end: a program → C text → a library, kept by its content."""
