"""A function as a graph: nodes and the rules that simplify them, the trace of one call, the order of its arithmetic."""
