"""Read the text of a vehicle file with the line of every key, and write it with comments and the rest unchanged."""
