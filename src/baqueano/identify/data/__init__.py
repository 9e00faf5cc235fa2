"""Convert runs to the rows of a fit.

record          rows of one run: commands, and the readings of each sensor
averaging       readings that are means over an interval
added_channels  the truth, the voltage of the battery, and measurements by hand
"""
