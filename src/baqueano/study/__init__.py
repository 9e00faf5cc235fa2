"""The demo, the paper's case studies, and the judgement of real recordings: each a command with a verdict."""
