"""The vehicle for programs that speak Foxglove's protocol: they look, and change nothing."""
