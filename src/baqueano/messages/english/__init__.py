"""English templates of the messages."""
