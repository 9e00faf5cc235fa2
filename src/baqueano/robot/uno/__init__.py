"""Drive the motors through the Uno: the frames sent to it, its serial line, and the settings that it stores."""
