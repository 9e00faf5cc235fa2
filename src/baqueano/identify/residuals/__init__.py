"""Compute residuals r(θ) of a run, with their derivatives.

simulation        z − h of a simulation: the residuals of a fit
motion            one row of it: start, readings, motion
gyro_aided        the same with the yaw rate of a gyro
innovations       z − h of a filter that also estimates the floor
informative_rows  rows that show the noise of a channel, and bounds of its σ
"""
