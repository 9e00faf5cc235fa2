"""The service of a vehicle: it watches the hardware, drives missions, and stops for every reason there is."""
