"""The Python back end: a program → text of plain floats, for use without a C compiler."""
