"""The map of an import: which column is which signal, in which unit, on which clock. The maps in TOML stand beside.

columns, column_map    what a map says, and the reading of its text
units                  units of recordings → SI
mount                  where the mark of a truth sits on the vehicle
"""
