"""What the data show, and what they do not."""
