"""Lab worker: a child of the page process that reads runs and computes, over pipes. It opens no socket.

handle      the page's end
worker      the child: python -m baqueano.web.lab.worker
recorded    a run as rows of numbers, and what stands around them
shelf       the runs of a folder, their reports
"""
