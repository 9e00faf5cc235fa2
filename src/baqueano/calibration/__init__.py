"""Calibrate the sensors of a run without a model of the vehicle: scale, bias, noise and clock.

against_truth      scales, mark and clock, by the pose that a camera measured
hand_turns         scale and bias of a gyro, by whole turns made by hand
hand_measurements  distances and angles that a person measured, for a fit
at_rest            noise, bias and its walk, by Allan's deviation
rest               the bias of a gyro in the rests of a run, and how a run begins
tolerances         the errors of scales and zeros that a file or a data sheet gives
result             the numbers with their error bars, and the changed vehicle file
"""
