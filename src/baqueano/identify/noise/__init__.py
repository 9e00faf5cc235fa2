"""Measure the noise of sensors and model: Q and R of a filter.

covariances           `measure_noise`: Q by the residuals of the fit, R by one of the next two
process_noise         R of the paper's filter, by the truth or by its innovations
filter_noise          the noise of the recommended filter, by its innovations
accelerometer_misfit  which part of the wheels' error is slip
speed_error           the lasting error of the model's speed
speed_channels        accelerometers that correct the speed, on held-out runs
held_out              tests of the noise on held-out runs
"""
