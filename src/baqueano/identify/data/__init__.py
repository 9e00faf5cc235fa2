"""Convert runs to the rows of a fit.

record             rows of one run: commands, and the readings of each sensor
averaging          readings that are means over an interval
added_channels     the truth and the voltage of the battery
hand_measurements  distances and angles that were measured by hand
"""
