"""Search the θ of least cost.

search            Huber cost, with σ of the noise estimated
delay             the same with a free delay
prediction_error  likelihood of the innovations, with process noise
"""
