"""Represent a function as a graph: nodes, simplification rules, the trace of a call, the order of the operations."""
