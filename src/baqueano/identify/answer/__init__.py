"""Parameters → an answer: error bars, what was not seen, which cost to believe, and a verdict in words."""
