"""Read tables of numbers from external files: CSV files and topics of ROS bags, as columns of text.

lines, cells    the text of a file, one line at a time, in little memory
table           CSV → columns, columns → numbers
bag             topics of a bag → columns
"""
