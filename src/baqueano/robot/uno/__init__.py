"""The Uno, which holds the motors: what is said to it, over which line, and what it keeps."""
