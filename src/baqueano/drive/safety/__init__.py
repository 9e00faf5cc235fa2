"""Take precautions for a drive along a route: checks before it begins, and observers that slow and stop it."""
