"""Measure the noise of sensors and model: Q and R of a filter.

covariances    `measure_noise`: Q by the residuals of the fit, R by one of the next two
process_noise  R of the paper's filter, by the truth or by its innovations
filter_noise   the noise of the recommended filter, by its innovations
speed_error    slip of the wheels, the lasting error of the model's speed, and the error that the truth shows
held_out       decisions on held-out runs: channels that correct the speed, and a test of the noise
"""
