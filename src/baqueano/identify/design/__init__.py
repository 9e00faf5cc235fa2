"""Design of experiments: as much information as a room, a vehicle and a time allow."""
