"""Design the experiment that gives the most information about a vehicle in its room and in the given time.

plan            the most informative drive: `design_plan`
compose         motion primitives, and their order in the room
information     Fisher information of a drive, exactly, before the drive
live            the same during a drive, and the motion to drive next
vehicle_cloud   the vehicles that a file with its errors considers possible
containment     signals with which the vehicle stays in a room
"""
