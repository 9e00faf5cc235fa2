"""The Python back end: a program → text of plain floats, where there is no C compiler."""
