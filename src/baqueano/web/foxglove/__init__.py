"""Publish the vehicle to programs that use Foxglove's protocol, with read-only access."""
