"""Publish the vehicle to programs that use Foxglove's protocol; they have read-only access."""
