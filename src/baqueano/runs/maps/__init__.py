"""Describe the signal, unit and clock of each column of an import. The maps in TOML are in the same folder.

columns, column_map    the content of a map, and its parser
units                  units of recordings → SI
mount                  the pose of the camera's target on the vehicle
"""
