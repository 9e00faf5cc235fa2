"""The text of a vehicle file: read with the line of every key, written back with comments and the rest as it was."""
