"""The demo, the paper's case studies, and the evaluation on real recordings: each a command with a verdict."""
