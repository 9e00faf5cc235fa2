"""Compile a program in C: program → C code → a library, stored under a hash of its content."""
