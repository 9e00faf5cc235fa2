"""The Uno, which holds the motors: the frames sent to it, its serial line, and the settings that it keeps."""
