"""Generate Python code of plain floats from a program, for use without a C compiler."""
