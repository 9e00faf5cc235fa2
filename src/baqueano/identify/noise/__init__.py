"""Measure the noise of sensors and model: Q and R of a filter.

covariances    `measure_noise`: Q by the residuals of the fit, R by one of the next two
process_noise  R of the paper's filter, by the truth or by its innovations
filter_noise   the noise of the recommended filter, by its innovations
truth_noise    the disturbance of a kinematic model, by the truth of the runs
speed_error    slip of the wheels, and the lasting error of the model's speed
held_out       decisions on held-out runs: channels that correct the speed, and a test of the noise
"""
