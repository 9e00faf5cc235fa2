"""Differentiate: the rule of each operator, dual numbers, forward tangents of a program, normal equations."""
