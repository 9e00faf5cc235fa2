"""Provide the studies. Each is a command with a verdict.

demo, paper                        the whole method on a simulated vehicle; the case studies of the paper
truth, truth_drives                the independent simulator, and the loop around its vehicles
counterpart                        its vehicles in the form of the package: files, true values, worlds, runs
identification, faults             fits compared with their bound; damaged runs that a fit must detect
estimation, corridor, laps         the estimate and its covariance, up to fifty laps
driving, controllers               the errors along a route; first_drives, experiments: the way to a first fit
recordings, recorded               fits of real vehicles; imu_only and cross_validation_cpm: of one car
"""
