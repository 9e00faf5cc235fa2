"""Design of experiments: as much information as the room, the vehicle and the duration allow."""
