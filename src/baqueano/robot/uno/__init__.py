"""Command the motors through the Uno: its frames, its serial line, and the settings that it stores."""
