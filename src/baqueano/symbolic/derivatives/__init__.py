"""Derivatives: the rule of each operator, dual numbers, forward tangents of a whole program, normal equations."""
