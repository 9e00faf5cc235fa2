"""Convert the ticks of a drive to messages, with its vehicle and its route."""
