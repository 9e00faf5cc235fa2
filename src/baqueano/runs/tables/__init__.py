"""Read tables from external files, CSV files and topics of ROS bags, as columns of text or numbers.

lines, cells    the text of a file, one line at a time, in little memory
table           CSV → columns, columns → numbers
bag             topics of a bag → columns
"""
